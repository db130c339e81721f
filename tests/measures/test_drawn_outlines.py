"""Outlines of subjects drawn by hand, which numbers outside of them are measured with."""

from __future__ import annotations

import json
from pathlib import Path

OUTLINES = json.loads((Path(__file__).parents[1] / "data" / "outlines.json").read_text())
BEAR = OUTLINES["bear"]


def area(outline):
    """Square pixels inside a polygon that alternates x and y."""
    x, y = outline[::2], outline[1::2]
    ends = zip(x, y, x[1:] + x[:1], y[1:] + y[:1])
    return abs(sum(a * d - c * b for a, b, c, d in ends)) / 2


def test_ten_photos_have_outlines_that_lie_in_the_picture():
    assert len({view["photo"] for view in BEAR}) == len(BEAR) == 10
    for view in BEAR:
        for outline in view["outlines"]:
            assert len(outline) % 2 == 0
            assert all(0 <= each <= 512 for each in outline)
        assert 0.1 < sum(map(area, view["outlines"])) / 512**2 < 0.6, view["photo"]
