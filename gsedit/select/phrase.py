"""A phrase about a thing of a scene, without a network: color, size, place, up and down, relations.

"The second small red ball from the left on the table" is read as a `Query` over segments, by the
words of gsedit/words/things.txt and the names of colors. A noun like "chair" is not known; with a
color or place beside it, those decide, and a note says so.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from colorsys import rgb_to_hsv
from dataclasses import replace
from math import exp

import numpy as np
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import Said, UsageError
from gsedit.select.masked import MaskProvider, find_masked
from gsedit.select.query import RELATIONS, THINGS, Query, read_phrase
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments, segment
from gsedit.words.colors import PLAIN
from gsedit.words.colors import named as color_of
from gsedit.words.scan import tokens
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

SIDED = frozenset(("left", "right", "front", "back", "middle"))
"""Orders and relations that depend on where one looks from."""
NEARER = 0.6
"""Ratio of two distances below which the nearer thing is the one that is meant."""
OVERLAP = 0.3
"""Least share of an object that the subject covers, for it to be the object."""
CLEAR = 0.1
"""Least distance between two things in an order, of the larger one's size."""
SAYABLE = (
    "say a color, size or place, as in 'the red one', 'the largest', 'second from the left', "
    "'left of the red one', 'the ground' or 'the background'"
)
Subject = Callable[[], Bool[Tensor, " n"] | None]
"""A map to the flags of the main subject, which is called where a phrase needs it; None: none."""


def find_phrase(
    phrase: str,
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    segments: Segments | None = None,
    subject: Subject | None = None,
    masks: MaskProvider | None = None,
) -> Region:
    """Find what a phrase names in a scene; right and left are as the first of the cameras sees it.

    `segments` are those of the scene, where they are known (`segment`). With `masks`, a phrase with
    a noun that is not known is found in pictures. Raises UsageError for a phrase that names
    nothing, several things where it says one, or the whole scene.
    """
    queries = read_phrase(phrase)
    if not queries:
        raise UsageError(f"the phrase is empty: {SAYABLE}")
    if masks is not None and any(query.asks_network for query in queries):
        return find_masked(phrase, scene, masks, cameras)
    found = segment(scene, cameras) if segments is None else segments
    finder = _Finder(phrase, found, subject)
    named = finder.named()
    numbers = named or sorted({row.number for query in queries for row in finder.find(query)})
    inside = found.inside(*numbers)
    if inside.all() or not inside.any():
        raise UsageError(
            f"'{phrase}' is {'the whole scene' if inside.all() else 'nothing'}: name a part, or "
            "leave the selection out"
        )
    return Region(inside, f"{finder.told(numbers)}{''.join('; ' + each for each in finder.notes)}")


def carrier(segments: Segments) -> Region | None:
    """The thing that most other things stand on, as a table; None where none is stood on."""
    carried = segments.carried
    if not carried:
        return None
    most = max(carried, key=lambda number: (carried[number], segments.rows[number].size))
    return Region(segments.inside(most), f"what carries {carried[most]} things")


class _Finder:
    """The segments that queries mean, with remarks for a person."""

    def __init__(self, phrase: str, segments: Segments, subject: Subject | None) -> None:
        self.phrase, self.segments, self.subject = phrase, segments, subject
        self.white = white_of(segments)
        self.names = names(segments)
        self.notes: dict[str, None] = {}

    def told(self, numbers: Sequence[int]) -> str:
        """Segments by their short names."""
        rows, names = self.segments.rows, self.names
        ones = {i for i in numbers if rows[i].kind == "object" and " object " not in names[i]}
        return ", ".join(f"the {names[i]}{' one' if i in ones else ''}" for i in numbers)

    def named(self) -> list[int]:
        """The segment that the phrase names by its number, as "object 2", or its short name, as
        "the large red one"; nothing without one. Raises UsageError for a number of no segment."""
        said = self.phrase.lower().strip().removeprefix("the ").removesuffix(" one")
        if numbered := re.fullmatch(r"object (\d+)", said):
            number = int(numbered[1])
            if number >= len(self.segments.rows):
                raise self._refusal(f"the numbers are 0 to {len(self.segments.rows) - 1}")
            return [number]
        return [i for i, name in enumerate(self.names) if name == said]

    def find(self, query: Query) -> list[Segment]:
        """The segments of a query. Raises UsageError."""
        if query.unknown and not query.bare:
            self.notes.setdefault(
                f"what a {' '.join(query.unknown)} is cannot be known without a network (--masks); "
                "found by the other words"
            )
        if query.kind == "everything":
            return self._everything(query)
        kind = "object" if query.kind == "subject" else query.kind
        rows = self._kind(kind)
        if kind == "background":
            rows = self._kind("background", "sky") or self._kind("wall")
        if not rows:
            raise self._refusal(f"the scene has no {query.kind}")
        if query.bare and not query.plural and not query.place:
            return self._main(query)
        if query.bare and query.unknown:
            what = f"which things are {' '.join(query.unknown)} cannot be known without a network"
            raise self._refusal(what, move="objects-masks")
        return self._left_out(self._narrowed(query, rows), query)

    def _everything(self, query: Query) -> list[Segment]:
        rows = list(self.segments.rows)
        if query.relations or query.colors:
            plural = replace(query, kind="object", plural=True)
            return self._left_out(self._narrowed(plural, self._kind("object")), query)
        if not query.excluded:
            raise self._refusal("that is the whole scene")
        return self._left_out(rows, query)

    def _left_out(self, rows: list[Segment], query: Query) -> list[Segment]:
        out = {row.number for each in query.excluded for row in self.find(each)}
        kept = [row for row in rows if row.number not in out]
        if not kept:
            raise self._refusal("nothing is left")
        return kept

    def _narrowed(self, query: Query, rows: list[Segment]) -> list[Segment]:
        """The rows that all words of a query leave."""
        rows = self._colored(query, rows)
        for relation, ends in query.relations:
            try:
                rows = self._related(relation, ends, rows, query)
            except UsageError:
                if not query.colors or not any(each.bare and each.unknown for each in ends):
                    raise
                self.notes[f"'{_SAID[relation]} ...' names nothing known, and is left out"] = None
        if query.size:
            rows = self._sized(query, rows)
        if query.order is not None:
            return self._placed(query, query.order, rows)
        if query.place:
            raise self._refusal("say from which side to count, as in 'second from the left'")
        if not rows:
            raise self._refusal("nothing is like that")
        if query.count and len(rows) != query.count:
            raise self._refusal(f"not {query.count} but {len(rows)} are like that", rows)
        if len(rows) > 1 and not query.plural and query.kind == "object":
            raise self._refusal("several are like that: say which", rows)
        return rows

    def _colored(self, query: Query, rows: list[Segment]) -> list[Segment]:
        if query.colors:
            of_each = [of_color(rows, color, self.white) for color in query.colors]
            if query.plural:
                rows = [row for row in rows if any(row in some for some in of_each)]
            else:
                rows = [row for row in of_each[0] if all(row in some for some in of_each)]
            if not rows:
                raise self._refusal("nothing there is of that color")
        for color in query.other_than:
            wrong = {row.number for row in of_color(rows, color, self.white)}
            rows = [row for row in rows if row.number not in wrong]
        return rows

    def _sized(self, query: Query, rows: list[Segment]) -> list[Segment]:
        """The smallest or largest of few, or those beyond the widest step in size of several."""
        size = _KEYS["height" if query.upright else "size"]
        rows = self._no_furniture(query, rows)
        rows = sorted(rows, key=size, reverse=query.size > 0)
        if len(rows) < 2:
            return rows
        sizes = np.array([size(row) for row in rows])
        steps = np.minimum(sizes[1:], sizes[:-1]) / np.maximum(sizes[1:], sizes[:-1]).clip(1e-12)
        cut = int(np.argmin(steps)) + 1 if query.plural else 1
        if steps[cut - 1] > APART:
            raise self._refusal("they are of about one size", rows)
        return rows[:cut]

    def _no_furniture(self, query: Query, rows: list[Segment]) -> list[Segment]:
        """The rows without what carries several things, where a noun that is not known is said:
        "the big ball" is not the table."""
        kept = [row for row in rows if self.segments.carried[row.number] < 2]
        return kept if kept and query.unknown else rows

    def _placed(self, query: Query, order: str, rows: list[Segment]) -> list[Segment]:
        """The thing at a place in an order."""
        if order in SIDED:
            self._seen_from()
        key = _KEYS[order]
        if order == "middle":
            at = np.median([row.middle[0] for row in self._kind("object")])
            rows = sorted(rows, key=lambda row: abs(row.middle[0] - at))
        else:
            rows = self._no_furniture(query, rows) if order == "size" else rows
            rows = sorted(rows, key=key, reverse=True)
        place = query.place if query.place >= 0 else len(rows) + query.place
        if not 0 <= place < len(rows):
            raise self._refusal(f"only {len(rows)} are like that", rows)
        if query.plural and query.place == 0 and order in SIDED:
            half = np.median([key(row) for row in self._kind("object")])
            return [row for row in rows if key(row) > half] or rows[:1]
        beside = [rows[i] for i in (place - 1, place + 1) if 0 <= i < len(rows)]
        here = rows[place]
        if order not in ("size", "height", "middle") and any(
            abs(key(each) - key(here)) < CLEAR * min(each.size, here.size) for each in beside
        ):
            raise self._refusal("they are beside each other in that order", [here, *beside])
        return [here]

    def _related(
        self, relation: str, ends: Sequence[Query], rows: list[Segment], query: Query
    ) -> list[Segment]:
        """The rows that stand so to the things of a relation."""
        others = [self._reference(each, relation) for each in ends]
        numbers = {row.number for some in others for row in some}
        rows = [row for row in rows if row.number not in numbers]
        if relation in SIDED:
            self._seen_from()
        if relation == "between":
            both = [row for some in others for row in some]
            if len(both) != 2:
                raise self._refusal("between needs two things")
            return [min(rows, key=lambda row: _from_line(row, *both))] if rows else []
        reference = others[0][0]
        if relation == "on":
            found = [row for row in rows if row.stands_on in numbers]
        elif relation == "under":
            carriers = {r.stands_on for r in others[0]}  # the ground too
            found = [row for row in self.segments.rows if row.number in carriers]
            found = [row for row in found if row in rows or row.kind != "object"]
            found = found or [row for row in rows if _over(reference, row)]
        elif relation == "above":
            found = [row for row in rows if _over(row, reference)]
        elif relation == "beside":
            found = [row for row in rows if row.number != reference.stands_on]
        else:
            found = [row for row in rows if _towards(relation, row, reference)]
        if not found:
            raise self._refusal(f"nothing is {_SAID[relation]} {self.told(sorted(numbers))}")
        told = query.size or query.order or query.plural or relation in ("on", "under")
        return found if told else self._nearest(found, reference)

    def _nearest(self, rows: list[Segment], reference: Segment) -> list[Segment]:
        """The row that is clearly nearest to another; all where none is."""
        rows = sorted(rows, key=lambda row: gap(row, reference))
        if len(rows) > 1 and gap(rows[0], reference) > NEARER * gap(rows[1], reference):
            return rows
        return rows[:1]

    def _reference(self, query: Query, relation: str) -> list[Segment]:
        """The thing that a relation is to; what carries things is meant by "on the table"."""
        if relation == "on" and query.bare and query.kind == "object":
            (one, most), (_, other), *_ = [*self.segments.carried.most_common(2), (0, 0), (0, 0)]
            if most > other:
                self.notes.setdefault(f"taken for what carries things: {self.told([one])}")
                return [self.segments.rows[one]]
        return self.find(query)

    def _main(self, query: Query) -> list[Segment]:
        """The subject of the scene: its only object, or what the subject's flags cover."""
        rows = self._kind("object")
        noun = " ".join(query.unknown)
        if noun and THINGS & set(tokens(self.phrase)):
            raise self._refusal(f"what is meant by '{noun}' is not known")
        chosen = rows[0] if len(rows) == 1 else None
        if chosen is None and self.subject is not None and (flags := self.subject()) is not None:
            shares = {row.number: self._overlap(row, flags) for row in rows}
            best = max(rows, key=lambda row: shares[row.number])
            chosen = best if shares[best.number] > OVERLAP else None
        if chosen is None:
            if not noun:
                raise self._refusal("several things are there", rows)
            what = f"what a {noun} is cannot be known without a network"
            raise self._refusal(what, rows, "objects-masks")
        if noun:
            self.notes.setdefault(f"'{noun}' was taken for the main subject")
        return self._left_out([chosen], query)

    def _overlap(self, row: Segment, flags: Bool[Tensor, " n"]) -> float:
        own = self.segments.inside(row.number)
        return float((own & flags).sum() / (own | flags).sum().clamp_min(1))

    def _kind(self, *kinds: str) -> list[Segment]:
        return [row for row in self.segments.rows if row.kind in kinds]

    def _seen_from(self) -> None:
        view = self.segments.view + 1
        self.notes.setdefault(f"left, right, front and back as view {view} sees them")

    def _refusal(
        self, why: str, among: Sequence[Segment] = (), move: str = "objects"
    ) -> UsageError:
        """The error for a phrase, with what there is."""
        rows = list(among) or [row for row in self.segments.rows if row.kind != "background"]
        return UsageError(
            Said(
                f"'{self.phrase}': {why}; {'these are' if among else 'there is'} "
                f"{self.told([row.number for row in rows])}. {SAYABLE[0].upper()}{SAYABLE[1:]}",
                move,
            )
        )


_KEYS: dict[str, Callable[[Segment], float]] = {
    "size": lambda row: row.size,
    "height": lambda row: row.high[2] - row.low[2],
    "left": lambda row: -row.middle[0],
    "right": lambda row: row.middle[0],
    "front": lambda row: -row.middle[1],
    "back": lambda row: row.middle[1],
    "top": lambda row: row.high[2],
    "bottom": lambda row: -row.low[2],
    "middle": lambda row: -abs(row.middle[0]),
}
_SAID = {relation: phrase for phrase, relation in reversed(RELATIONS.items())}
"""Words for each relation, the first of its row."""


def _towards(relation: str, row: Segment, other: Segment) -> bool:
    """Whether a thing is on a side of another, by more than it is off to it."""
    x, y, _ = np.subtract(row.middle, other.middle)
    along = {"left": -x, "right": x, "front": -y, "back": y}[relation]
    return bool(along > CLEAR * min(row.size, other.size))


def _over(upper: Segment, lower: Segment) -> bool:
    """Whether a thing is higher than another and over or beside it."""
    apart = np.abs(np.subtract(upper.middle, lower.middle))[:2]
    half = (np.subtract(upper.high, upper.low) + np.subtract(lower.high, lower.low))[:2] / 2
    return bool(upper.middle[2] > lower.middle[2] and (apart < half).all())


def gap(row: Segment, other: Segment) -> float:
    """The distance between two boxes along the ground and up, at least a small share of a size."""
    apart = np.maximum(np.subtract(row.low, other.high), np.subtract(other.low, row.high))
    return float(np.linalg.norm(apart.clip(min=0))) + 0.02 * other.size


def _from_line(row: Segment, first: Segment, second: Segment) -> float:
    """How much longer the way from one thing to another is by way of a third."""
    a, b, c = (np.array(each.middle) for each in (first, second, row))
    return float(np.linalg.norm(c - a) + np.linalg.norm(c - b) - np.linalg.norm(b - a))


# ---- colors and sizes in words: of light and shade, so hue counts more than lightness -----------

HUE, SATURATION, VALUE = 22 / 360, 0.6, 0.4
"""Differences of hue (of a full circle), saturation and value at which a color is another."""
GREY_CHROMA, GREY = 0.12, 0.13
"""Largest chroma (saturation times value) of an asked color that has no hue; and chroma at which
what is asked for without a hue is another."""
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
    clear = min(saturation / 0.25, 1.0) ** 2  # a paler thing has hardly a hue
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
        if below >= 0.95 * total:
            return max(value, 0.1)
    return 1.0


def of_color(rows: list[Segment], color: str, white: float) -> list[Segment]:
    """The segments of a color "#rrggbb", the most alike first."""
    scores = {row.number: likeness(row, color, white) for row in rows}
    best = max(scores.values(), default=0.0)
    alike = [r for r in rows if scores[r.number] >= max(OF_COLOR, AS_MUCH * best)]
    return sorted(alike, key=lambda row: -scores[row.number])


def names(segments: Segments) -> tuple[str, ...]:
    """A short name for each segment: "large red", "small red", "ground", "gray wall".

    Objects of one color are told apart by size where it differs clearly, else by numbers.
    """
    white, colors = white_of(segments), dict[int, str]()
    for row in segments.rows:
        scores = {
            name: likeness(row, color_of(name) or "", white) * (1 if name in GREYS else CLEARER)
            for name in BASIC
        }
        colors[row.number] = max(BASIC, key=lambda name: scores[name])
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
