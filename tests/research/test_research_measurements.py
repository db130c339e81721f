"""The table of measurements of the renderer."""

from __future__ import annotations

from benchmarks import render_measurement
from research.renderer.measurements import HEAD, table


def test_the_table_has_a_section_a_scene():
    missing = ("forward_wall", "forward_cpu", "both_wall", "both_cpu", "error_mean",
               "peak_bytes")  # fmt: skip
    failed = render_measurement(
        implementation="textbook conic", knob="baseline", runs=0, note="it raised",
        **dict.fromkeys(missing),
    )  # fmt: skip
    text = table([render_measurement(), failed, render_measurement(scene="cage")])
    assert text.count("## ") == 2
    assert "## columns\n\n1,000 Gaussians, 64x48, float32; 0.005 / 0.32 million" in text
    line = next(part for part in text.splitlines() if part.startswith("| **default**"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["**default**", "30", "55", "90", "160", "8.0e-08", "2.0e-06",
                     "3.0e-04", "2.0e-05", "1.0e-09", "50", "5"]  # fmt: skip
    assert "- textbook conic: it raised" in text
    widths = {len(part.split("|")) for part in text.splitlines() if part.startswith("|")}
    assert widths == {len(HEAD) + 2}
