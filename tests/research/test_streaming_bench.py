"""The script that compares gsedit with splat-transform runs, and cleans up."""

from __future__ import annotations

import sys

from research import streaming_bench


def test_the_bench_prints_a_row_a_command(tmp_path, monkeypatch, capsys):
    words = ["streaming_bench.py", str(tmp_path), "--count", "300", "--degree", "1", "--only", ""]
    monkeypatch.setattr(sys, "argv", [*words[:-1], "gsedit convert .ply"])
    streaming_bench.main()
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| gsedit")]
    assert len(rows) == 1
    assert float(rows[0].split("|")[3]) > 0
    assert [path.suffix for path in tmp_path.iterdir()] == [".ply"]
