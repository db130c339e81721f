"""Plots show what was measured; labels do not overlap."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from benchmarks import count_near, render_measurement, rgb
from research.renderer import plots
from research.renderer.pareto import pareto

STOPS = [
    render_measurement(
        knob="stop", value=value, forward_wall=wall, both_wall=3 * wall, error_mean=error,
        gradient_error=100 * error,
    )
    for value, wall, error in (("0", 0.04, 7e-8), ("0.001", 0.02, 1e-5), ("0.01", 0.015, 3e-4))
]  # fmt: skip


@pytest.mark.parametrize("which", ["image", "gradients"])
def test_the_plot_shows_points_front_and_defaults(tmp_path, which):
    path = tmp_path / "plot.png"
    plots.work_precision(
        [render_measurement(), *STOPS, render_measurement(scene="cage")], path, which
    )
    pixels = rgb(path)
    assert count_near(pixels, plots.STYLES["stop"][0]) > 100
    assert count_near(pixels, "#bbbbbb") > 300  # the front
    assert count_near(pixels, plots.STYLES["tile"][0]) < 20  # nothing of what was not measured
    assert count_near(pixels, "#ffffff") > 0.5 * len(pixels)


def test_a_plot_of_nothing_says_so(tmp_path):
    failed = render_measurement(forward_wall=None, both_wall=None, note="it raised")
    plots.work_precision([failed], tmp_path / "a.png", "image")
    plots.work_precision([], tmp_path / "b.png", "image")
    assert count_near(rgb(tmp_path / "a.png"), "#000000") > 100


def test_errors_of_zero_are_drawn_at_the_floor(tmp_path):
    exact = render_measurement(knob="dtype", value="float64", error_mean=0.0)
    mark = plots._mark(exact, "image")
    assert mark.error == plots.FLOOR
    assert mark.value == "float64 (0e+00)"
    plots.work_precision([render_measurement(), exact], tmp_path / "a.png", "image")


def test_labels_do_not_overlap():
    window = (0.0, 0.0, 200.0, 100.0)
    taken: list = []
    for x, y in itertools.product(range(10, 200, 30), range(10, 100, 20)):
        place = plots._free(float(x), float(y), 24.0, 9.0, taken, window)
        if place is None:
            continue
        box = (*place, place[0] + 24, place[1] + 9)
        assert not any(plots.overlap(box, other) for other in taken)
        assert box[0] >= 0
        assert box[1] >= 0
        assert box[2] <= 200
        assert box[3] <= 100
        taken.append(box)
    assert len(taken) > 10
    assert plots._free(100.0, 50.0, 24.0, 9.0, [window], window) is None


@pytest.mark.parametrize("seed", range(20))
def test_the_front_is_what_no_point_dominates(seed):
    numbers = np.random.default_rng(seed).integers(0, 6, (seed, 2)).astype(float)  # many ties
    points = [(float(x), float(y)) for x, y in numbers]

    def beaten(point):
        return any(q != point and q[0] <= point[0] and q[1] <= point[1] for q in points)

    assert pareto(points) == sorted({p for p in points if not beaten(p)})
