"""What a cloud of points (cost, error) says: its Pareto front, and the slope of its logarithms."""

from __future__ import annotations

from collections.abc import Sequence
from math import log

Point = tuple[float, float]


def pareto(points: Sequence[Point]) -> list[Point]:
    """The points than which none is at least as good in both numbers and better in one.

    Cheapest first, without repetitions. Smaller is better.
    """
    front: list[Point] = []
    for point in sorted(set(points)):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def slope(points: Sequence[Point]) -> float:
    """Least-squares slope of log y over log x: 1 where y is proportional to x.

    Raises ValueError for fewer than two different x, or a number that is not positive.
    """
    if any(value <= 0 for point in points for value in point):
        raise ValueError("logarithms need positive numbers")
    if len({x for x, _ in points}) < 2:
        raise ValueError("a slope needs two points that differ in x")
    logs = [(log(x), log(y)) for x, y in points]
    centre_x, centre_y = (sum(column) / len(logs) for column in zip(*logs))
    rise = sum((x - centre_x) * (y - centre_y) for x, y in logs)
    return rise / sum((x - centre_x) ** 2 for x, _ in logs)
