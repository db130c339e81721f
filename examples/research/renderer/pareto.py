"""Pareto front of measurements (cost, error)."""

from __future__ import annotations

from collections.abc import Sequence

from research.curves import Point


def pareto(points: Sequence[Point]) -> list[Point]:
    """The points than which none is at least as good in both numbers and better in one.

    Cheapest first, without repetitions. Smaller is better.
    """
    front: list[Point] = []
    for point in sorted(set(points)):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front
