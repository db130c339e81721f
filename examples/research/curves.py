"""Exponent of a power law through measured points."""

from __future__ import annotations

from collections.abc import Sequence
from math import log

Point = tuple[float, float]


def slope(points: Sequence[Point]) -> float:
    """Least-squares slope of log y over log x: 1 where y is proportional to x.

    Raises ValueError for fewer than two different x, or a number that is not positive.
    """
    if any(value <= 0 for point in points for value in point):
        raise ValueError("logarithms need positive numbers")
    if len({x for x, _ in points}) < 2:
        raise ValueError("a slope needs two points that differ in x")
    logs = [(log(x), log(y)) for x, y in points]
    center_x, center_y = (sum(column) / len(logs) for column in zip(*logs))
    rise = sum((x - center_x) * (y - center_y) for x, y in logs)
    return rise / sum((x - center_x) ** 2 for x, _ in logs)
