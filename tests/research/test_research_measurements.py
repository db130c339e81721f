"""Measurements survive JSON; their table and their comparison are right."""

from __future__ import annotations

import math
from math import nan

import pytest
from benchmarks import render_measurement
from research.renderer.measurements import HEAD, comparison, read_measurements, table

from gsedit.errors import InputError
from gsedit.runs.json_lines import write_line


def test_rows_survive_json(tmp_path):
    wanted = [
        render_measurement(),
        render_measurement(knob="peers", value="gsplat", forward_wall=None, note="raised"),
    ]
    with (tmp_path / "bench.jsonl").open("w") as file:
        for one in wanted:
            write_line(file, one)
        file.write('{"scene": "cut o')  # interrupted in the middle of a line
    assert read_measurements(tmp_path / "bench.jsonl") == wanted


def test_what_is_not_a_number_is_null(tmp_path):
    with (tmp_path / "bench.jsonl").open("w") as file:
        write_line(file, render_measurement(error_mean=nan, error_max=math.inf))
    (measurement,) = read_measurements(tmp_path / "bench.jsonl")
    assert measurement == render_measurement(error_mean=None, error_max=None)


def test_a_line_that_is_no_row_is_named(tmp_path):
    path = tmp_path / "bench.jsonl"
    path.write_text('{"stage": "fit"}\n')
    with pytest.raises(InputError, match=r"bench.jsonl, line 1: not a measurement"):
        read_measurements(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_measurements(tmp_path / "absent.jsonl")


def test_the_table_has_a_section_a_scene():
    missing = ("forward_wall", "forward_cpu", "both_wall", "both_cpu", "yardstick", "error_mean",
               "peak_bytes")  # fmt: skip
    failed = render_measurement(
        implementation="gsplat 1.5.3", knob="peers", runs=0, note="it raised",
        **dict.fromkeys(missing),
    )  # fmt: skip
    text = table([render_measurement(), failed, render_measurement(scene="cage")])
    assert text.count("## ") == 2
    assert "## columns\n\n1,000 Gaussians, 64x48, float32; 0.005 / 0.32 / 0.09 million" in text
    line = next(part for part in text.splitlines() if part.startswith("| **default**"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["**default**", "30", "2.0", "3.7", "90", "6.0", "10.7", "8.0e-08", "2.0e-06",
                     "3.0e-04", "2.0e-05", "1.0e-09", "50", "5"]  # fmt: skip
    assert "- gsplat 1.5.3: it raised" in text
    widths = {len(part.split("|")) for part in text.splitlines() if part.startswith("|")}
    assert widths == {len(HEAD) + 2}


def test_a_comparison_is_in_yardsticks():
    old = render_measurement(
        forward_wall=0.060, yardstick=0.030, both_wall=0.36
    )  # a machine half as fast
    text = comparison([render_measurement(), render_measurement(knob="tile", value="4")], [old])
    (line,) = [part for part in text.splitlines() if "columns" in part]
    assert [c.strip() for c in line.strip("|").split("|")] == [
        "columns: default", "1.00", "0.50", "1.00", "1.00",
    ]  # fmt: skip
