"""A phrase about a thing of a scene, without a network: color, size, place, up and down, relations.

A noun like "chair" is not known; with a color or place beside it, those decide, and a note says so.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import Said, UsageError
from gsedit.select.looks import APART, names, of_color, white_of
from gsedit.select.provider import MaskProvider
from gsedit.select.query import THINGS, Key, Query, Relation, read_phrase
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments, segment
from gsedit.words.tokens import tokens
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

Subject = Callable[[], Bool[Tensor, " n"] | None]
"""A map to the flags of the main subject, which is called where a phrase needs it; None: none."""
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


def find_phrase(
    phrase: str,
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    segments: Segments | None = None,
    subject: Subject | None = None,
    masks: MaskProvider | None = None,
    execution: Execution = AUTO,
) -> Region:
    """Find what a phrase names in a scene; right and left are as the first of the cameras sees it.

    `segments` are those of the scene, where they are known (`segment`). With `masks`, a phrase with
    a noun that is not known is found in pictures. Raises UsageError for a phrase that names
    nothing, several things where it says one, or the whole scene.
    """
    queries = read_phrase(phrase)
    if not queries:
        raise UsageError(f"the phrase is empty: {SAYABLE}")
    if masks is not None and any(_unknown(query) for query in queries):
        from gsedit.select.masked import find_masked

        return find_masked(phrase, scene, masks, cameras, execution)
    found = segment(scene, cameras, execution) if segments is None else segments
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


def _unknown(query: Query) -> bool:
    """Whether any noun of a query is not known."""
    others = [each for _, ends in query.relations for each in ends]
    return bool(query.unknown) or any(_unknown(each) for each in (*others, *query.excluded))


def carrier(segments: Segments) -> Region | None:
    """The thing that most other things stand on, as a table; None where none is stood on."""
    rows = {row.number: row for row in segments.objects}
    carried = Counter(row.stands_on for row in rows.values() if row.stands_on in rows)
    if not carried:
        return None
    most = max(carried, key=lambda number: (carried[number], rows[number].size))
    return Region(segments.inside(most), f"what carries {carried[most]} things")


class _Finder:
    """The segments that queries mean, with remarks for a person."""

    def __init__(self, phrase: str, segments: Segments, subject: Subject | None) -> None:
        self.phrase, self.segments, self.subject = phrase, segments, subject
        self.white = white_of(segments)
        self.names = names(segments)
        self.notes: list[str] = []

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
            self._note(
                f"what a {' '.join(query.unknown)} is cannot be known without a network (--masks); "
                "found by the other words"
            )
        if query.kind == "everything":
            return self._everything(query)
        if query.kind == "background":
            kinds = ("background", "sky") if self._kind("background", "sky") else ("wall",)
            rows = self._kind(*kinds)
        elif query.kind in ("ground", "sky", "wall"):
            rows = self._kind(query.kind)
        else:
            rows = self._kind("object")
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
                self._note(f"'{_SAID[relation]} ...' names nothing known, and is left out")
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
        size = _height if query.upright else _size
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
        carried = [row.stands_on for row in self._kind("object")]
        kept = [row for row in rows if carried.count(row.number) < 2]
        return kept if kept and query.unknown else rows

    def _placed(self, query: Query, order: Key, rows: list[Segment]) -> list[Segment]:
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
            return self._halved(rows, order)
        beside = [rows[i] for i in (place - 1, place + 1) if 0 <= i < len(rows)]
        here = rows[place]
        if order not in ("size", "height", "middle") and any(
            abs(key(each) - key(here)) < CLEAR * min(each.size, here.size) for each in beside
        ):
            raise self._refusal("they are beside each other in that order", [here, *beside])
        return [here]

    def _halved(self, rows: list[Segment], order: Key) -> list[Segment]:
        """The things on one side of the middle of all."""
        key = _KEYS[order]
        middle = np.median([key(row) for row in self._kind("object")])
        return [row for row in rows if key(row) > middle] or rows[:1]

    def _related(
        self, relation: Relation, ends: Sequence[Query], rows: list[Segment], query: Query
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

    def _reference(self, query: Query, relation: Relation) -> list[Segment]:
        """The thing that a relation is to; what carries things is meant by "on the table"."""
        if relation == "on" and query.bare and query.kind == "object":
            carried = [row.stands_on for row in self._kind("object")]
            carriers = [row for row in self._kind("object") if row.number in carried]
            carriers.sort(key=lambda row: -carried.count(row.number))
            most = [carried.count(row.number) for row in carriers[:2]]
            if most and (len(most) == 1 or most[0] > most[1]):
                self._note(f"taken for what carries things: {self.told([carriers[0].number])}")
                return carriers[:1]
        return self.find(query)

    def _main(self, query: Query) -> list[Segment]:
        """The subject of the scene: its only object, or what the subject's flags cover."""
        rows = self._kind("object")
        noun = " ".join(query.unknown)
        if noun and THINGS & set(tokens(self.phrase)):
            raise self._refusal(f"what is meant by '{noun}' is not known")
        if len(rows) == 1:
            chosen = rows[0]
        else:
            flags = None if self.subject is None else self.subject()
            chosen = None if flags is None else self._covered(rows, flags)
        if chosen is None:
            if not noun:
                raise self._refusal("several things are there", rows)
            what = f"what a {noun} is cannot be known without a network"
            raise self._refusal(what, rows, "objects-masks")
        if noun:
            self._note(f"'{noun}' was taken for the main subject")
        return self._left_out([chosen], query)

    def _covered(self, rows: list[Segment], flags: Bool[Tensor, " n"]) -> Segment | None:
        """The object that the subject's flags overlap most, if they do."""
        overlap = {}
        for row in rows:
            own = self.segments.inside(row.number)
            overlap[row.number] = float((own & flags).sum() / (own | flags).sum().clamp_min(1))
        best = max(rows, key=lambda row: overlap[row.number])
        return best if overlap[best.number] > OVERLAP else None

    def _kind(self, *kinds: str) -> list[Segment]:
        return [row for row in self.segments.rows if row.kind in kinds]

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)

    def _seen_from(self) -> None:
        self._note(f"left, right, front and back as view {self.segments.view + 1} sees them")

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


def _size(row: Segment) -> float:
    return row.size


def _height(row: Segment) -> float:
    return row.high[2] - row.low[2]


_KEYS: dict[Key, Callable[[Segment], float]] = {
    "size": _size,
    "height": _height,
    "left": lambda row: -row.middle[0],
    "right": lambda row: row.middle[0],
    "front": lambda row: -row.middle[1],
    "back": lambda row: row.middle[1],
    "top": lambda row: row.high[2],
    "bottom": lambda row: -row.low[2],
    "middle": lambda row: -abs(row.middle[0]),
}
_SAID: dict[Relation, str] = {
    "left": "left of", "right": "right of", "front": "in front of", "back": "behind", "on": "on",
    "under": "under", "above": "above", "beside": "beside", "between": "between",
}  # fmt: skip


def _towards(relation: Relation, row: Segment, other: Segment) -> bool:
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
