"""Pareto fronts and slopes of logarithms."""

from __future__ import annotations

import numpy as np
import pytest

from gsedit.bench.curves import pareto, slope


@pytest.mark.parametrize("seed", range(20))
def test_the_front_is_what_no_point_dominates(seed):
    numbers = np.random.default_rng(seed).integers(0, 6, (seed, 2)).astype(float)  # many ties
    points = [(float(x), float(y)) for x, y in numbers]

    def beaten(point):
        return any(q != point and q[0] <= point[0] and q[1] <= point[1] for q in points)

    assert pareto(points) == sorted({p for p in points if not beaten(p)})


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1.0, 2.5])
def test_the_slope_of_a_power_is_its_exponent(exponent):
    points = [(x, 3 * x**exponent) for x in (1.0, 10.0, 50.0, 1e4)]
    assert slope(points) == pytest.approx(exponent, abs=1e-12)  # a dozen roundings in float64


@pytest.mark.parametrize(
    "points", [[], [(1.0, 1.0)], [(2.0, 1.0), (2.0, 3.0)], [(0.0, 1.0), (1.0, 1.0)]]
)
def test_a_slope_needs_two_positive_points(points):
    with pytest.raises(ValueError, match=r"needs two|positive"):
        slope(points)
