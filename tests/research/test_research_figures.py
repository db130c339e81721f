"""Slopes of fitted lines through logarithms."""

from __future__ import annotations

import pytest
from research.figures import slope


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
