"""Colors and sizes of segments in words: which are of a color, and short names for all.

A color of a thing is seen in light and shade, so hue counts more than lightness.
"""

from __future__ import annotations

from collections import Counter
from colorsys import rgb_to_hsv
from math import exp

from gsedit.select.segment import Segment, Segments
from gsedit.words.colors import PLAIN, named

HUE, SATURATION, VALUE = 22 / 360, 0.6, 0.4
"""Differences of hue (of a full circle), saturation and value at which a color is another."""
GREY_CHROMA, GREY = 0.12, 0.13
"""Largest chroma (saturation times value) of an asked color that has no hue; and chroma at which
what is asked for without a hue is another."""
TINGE = 0.25
"""Saturation below which a thing has hardly a hue."""
WHITE_SHARE = 0.95
"""Share of the seen colors that are darker than what counts as white."""
OF_COLOR, AS_MUCH = 0.2, 0.6
"""Least likeness of a thing of a color, and as a share of the most alike one's."""
BASIC = tuple(name for name in PLAIN if name not in ("grey", "violet"))
"""Names of colors that things are told by."""
GREYS, CLEARER = ("black", "white", "gray"), 1.3
"""Colors without a hue, and how much more a hue counts: a striped thing is told by it."""
APART = 0.85
"""Ratio of two sizes below which one is the smaller."""


def likeness(segment: Segment, color: str, white: float) -> float:
    """How much of a segment is of a color "#rrggbb", in [0, 1]; `white`: value of white there."""
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    asked = rgb_to_hsv(red, green, blue)
    return sum(
        share * _alike(rgb_to_hsv(*rgb), asked, white) for rgb, share in segment.palette
    ) / max(sum(share for _, share in segment.palette), 1e-9)


def _alike(
    seen: tuple[float, float, float], asked: tuple[float, float, float], white: float
) -> float:
    hue, saturation, value = seen
    value = min(value / white, 1.0)
    lighter = exp(-(((value - asked[2]) / VALUE) ** 2))
    if asked[1] * asked[2] < GREY_CHROMA:
        return lighter * exp(-((saturation * value / GREY) ** 2))
    turn = abs(hue - asked[0])
    turn = min(turn, 1 - turn)
    clear = min(saturation / TINGE, 1.0) ** 2
    paler = exp(-(((saturation - asked[1]) / SATURATION) ** 2))
    return clear * lighter * paler * exp(-((turn / HUE) ** 2))


def white_of(segments: Segments) -> float:
    """The value of what is nearly the brightest that is seen, in (0, 1]."""
    seen = sorted(
        (max(rgb), share * row.pixels) for row in segments.rows for rgb, share in row.palette
    )
    total, below = sum(share for _, share in seen), 0.0
    for value, share in seen:
        below += share
        if below >= WHITE_SHARE * total:
            return max(value, 0.1)
    return 1.0


def of_color(rows: list[Segment], color: str, white: float) -> list[Segment]:
    """The segments of a color "#rrggbb", the most alike first."""
    scores = {row.number: likeness(row, color, white) for row in rows}
    best = max(scores.values(), default=0.0)
    alike = [r for r in rows if scores[r.number] >= max(OF_COLOR, AS_MUCH * best)]
    return sorted(alike, key=lambda row: -scores[row.number])


def color_name(segment: Segment, white: float) -> str:
    """The plain color that a segment is most of."""
    scores = {name: likeness(segment, named(name) or "", white) for name in BASIC}
    return max(BASIC, key=lambda name: scores[name] * (1 if name in GREYS else CLEARER))


def names(segments: Segments) -> tuple[str, ...]:
    """A short name for each segment: "large red", "small red", "ground", "gray wall".

    Objects of one color are told apart by size where it differs clearly, else by numbers.
    """
    white = white_of(segments)
    colors = {row.number: color_name(row, white) for row in segments.rows}
    told = {row.number: row.kind for row in segments.rows} | {
        row.number: colors[row.number] + (" wall" if row.kind == "wall" else "")
        for row in segments.rows
        if row.kind in ("object", "wall")
    }
    for name, count in Counter(told.values()).items():
        alike = [row for row in segments.rows if told[row.number] == name]
        if count > 1:
            told |= _apart(alike, name)
    return tuple(told[row.number] for row in segments.rows)


def _apart(rows: list[Segment], name: str) -> dict[int, str]:
    """Names of segments that would have one name."""
    if len(rows) == 2 and rows[1].size < APART * rows[0].size and rows[0].kind == "object":
        return {rows[0].number: f"large {name}", rows[1].number: f"small {name}"}
    if rows[0].kind == "object":
        return {row.number: f"{name} object {row.number}" for row in rows}
    return {row.number: f"{name} {i}" for i, row in enumerate(rows, 1)}
