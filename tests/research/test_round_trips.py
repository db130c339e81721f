"""The script that measures round trips prints a row a scene."""

from __future__ import annotations

from pathlib import Path

from research import round_trips

TINY = Path(__file__).parents[1] / "data" / "splats"


def test_a_row_has_a_cell_for_every_format(capsys):
    round_trips.main([TINY / "tiny.splat"])
    heads, _, row = capsys.readouterr().out.splitlines()
    assert row.count("|") == heads.count("|")
    cells = dict(zip(heads.split(" | "), row.split(" | ")))
    assert cells[".splat"].endswith("32.0 B")
    assert float(cells[".usda"].split()[0]) > 90
