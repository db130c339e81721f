"""A phrase about a thing as a query: its kind, colors, size, rank and relations; what is not known.

"the second small red ball from the left on the table" and the like; words by gsedit.words.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from gsedit.words.colors import longest
from gsedit.words.tokens import tokens

Key = Literal["size", "height", "left", "right", "front", "back", "top", "bottom", "middle"]
"""Order of things: the first is the largest, tallest, or farthest to that side."""
Relation = Literal["left", "right", "front", "back", "on", "under", "above", "beside", "between"]


def _words(text: str) -> frozenset[str]:
    """The set of the words of a text."""
    return frozenset(text.split())


KINDS = {
    **dict.fromkeys(("ground", "floor", "grass", "lawn", "soil", "earth", "pavement"), "ground"),
    **dict.fromkeys(("wall", "walls", "ceiling"), "wall"),
    **dict.fromkeys(("background", "backdrop", "surroundings", "backgrounds"), "background"),
    **dict.fromkeys(("sky", "skies"), "sky"),
    **dict.fromkeys(("everything", "anything"), "everything"),
}
"""Nouns that are known without a network."""
THINGS = _words("thing things one ones object objects item items stuff part parts")
SUBJECTS = frozenset(("subject", "it", "main"))
SKIPPED = _words(
    "the a an that which who is are was this these those my our your their its standing stands "
    "lying sitting placed located thats colored color scene picture really very most there "
    "select take find mark of camera viewer me us"
)
PLURAL = _words("all both every each two three four five these those")
COUNTS = {"both": 2, "two": 2, "three": 3, "four": 4, "five": 5}
ORDINALS = {"first": 0, "second": 1, "third": 2, "fourth": 3, "fifth": 4, "last": -1}
SMALL = _words("small little tiny smaller mini short shorter low lower thin")
LARGE = _words("large big huge larger bigger great giant tall taller high higher long wide")
UPRIGHT = _words("tall short high low taller shorter higher lower")
MOST: dict[str, tuple[Key, int]] = {
    **dict.fromkeys(("largest", "biggest", "hugest"), ("size", 0)),
    **dict.fromkeys(("smallest", "littlest", "tiniest"), ("size", -1)),
    "tallest": ("height", 0), "shortest": ("height", -1),
    "leftmost": ("left", 0), "rightmost": ("right", 0),
    "highest": ("top", 0), "topmost": ("top", 0), "uppermost": ("top", 0),
    "lowest": ("bottom", 0), "bottommost": ("bottom", 0),
    **dict.fromkeys(("nearest", "closest", "frontmost", "foremost"), ("front", 0)),
    **dict.fromkeys(("farthest", "furthest", "rearmost", "hindmost"), ("back", 0)),
}  # fmt: skip
"""Superlatives with the order and the place in it."""
SIDES: dict[str, Key] = {
    "left": "left", "right": "right", "front": "front", "foreground": "front", "back": "back",
    "rear": "back", "top": "top", "bottom": "bottom", "middle": "middle", "center": "middle",
    "centre": "middle",
}  # fmt: skip
RELATIONS: tuple[tuple[tuple[str, ...], Relation], ...] = (
    (("to", "the", "left", "of"), "left"), (("on", "the", "left", "of"), "left"),
    (("left", "of"), "left"), (("left", "from"), "left"),
    (("to", "the", "right", "of"), "right"), (("on", "the", "right", "of"), "right"),
    (("right", "of"), "right"), (("right", "from"), "right"),
    (("in", "front", "of"), "front"), (("before",), "front"),
    (("at", "the", "back", "of"), "back"), (("in", "back", "of"), "back"), (("behind",), "back"),
    (("on", "top", "of"), "on"), (("onto",), "on"), (("upon",), "on"), (("on",), "on"),
    (("underneath",), "under"), (("under",), "under"), (("below",), "under"),
    (("beneath",), "under"), (("above",), "above"), (("over",), "above"),
    (("next", "to"), "beside"), (("beside",), "beside"), (("near", "to"), "beside"),
    (("near",), "beside"), (("by",), "beside"), (("touching",), "beside"),
    (("closest", "to"), "beside"), (("nearest", "to"), "beside"), (("nearest",), "beside"),
    (("close", "to"), "beside"),
    (("between",), "between"),
)  # fmt: skip
"""Words of relations, longer ones before those that they begin with."""
EXCEPT = (
    ("but",),
    ("except", "for"),
    ("except",),
    ("apart", "from"),
    ("without",),
    ("other", "than"),
)


@dataclass(frozen=True)
class Query:
    """One noun phrase, as a query over segments."""

    kind: str = "object"
    """object, subject, or one of the values of KINDS."""
    colors: tuple[str, ...] = ()
    """Hex colors that it is of."""
    other_than: tuple[str, ...] = ()
    """Hex colors that it is not of."""
    size: int = 0
    """-1 small, 1 large."""
    upright: bool = False
    """Whether the size is its height."""
    order: Key | None = None
    place: int = 0
    """Place in the order, from 0; negative from the end."""
    relations: tuple[tuple[Relation, tuple[Query, ...]], ...] = ()
    plural: bool = False
    count: int = 0
    """Number of things that are said, 0 for any."""
    unknown: tuple[str, ...] = ()
    """Words that cannot be known without a network."""
    excluded: tuple[Query, ...] = ()
    """Things that are left out."""

    @property
    def bare(self) -> bool:
        """Whether nothing but nouns that are not known tells the thing."""
        return not (
            self.colors or self.other_than or self.size or self.order or self.relations
        ) and self.kind in ("object", "subject")


@dataclass
class _Reading:
    words: list[str]
    query: Query = field(default_factory=Query)
    nouns: list[str] = field(default_factory=list)


def read_phrase(phrase: str) -> tuple[Query, ...]:
    """The things that a phrase names, one after the other; a phrase without words has none."""
    return tuple(_query(part) for part in _listed([w for w in tokens(phrase) if w not in ".!?,;:"]))


def _listed(words: list[str]) -> list[list[str]]:
    """The parts of "the red one and the blue one"; "between A and B" and colors stay together."""
    parts, start, between = [], 0, False
    for at, word in enumerate(words):
        between |= word == "between"
        if word not in ("and", "plus") or not words[at + 1 :]:
            continue
        after = words[at + 1]
        if between:
            between = False
        elif after in ("the", "a", "all", "both", "every", "everything") or after in KINDS:
            parts.append(words[start:at])
            start = at + 1
    return [part for part in (*parts, words[start:]) if part]


def _query(words: list[str]) -> Query:
    for at in range(1, len(words)):
        if (used := _starts(words[at:], EXCEPT)) and at + used < len(words):
            left_out = tuple(_query(part) for part in _listed(words[at + used :]))
            return replace(_query(words[:at]), excluded=left_out)
    reading = _Reading(words)
    at = 0
    while at < len(words):
        at += _step(reading, words[at:])
    query = reading.query
    plain = [n for n in reading.nouns if n not in THINGS]
    plural = query.plural or any(_is_plural(n) for n in reading.nouns[-1:])
    return replace(query, unknown=tuple(plain), plural=plural)


def _is_plural(noun: str) -> bool:
    return noun == "stuff" or (noun.endswith("s") and not noun.endswith(("ss", "us")))


def _starts(words: list[str], forms: tuple[tuple[str, ...], ...]) -> int:
    """Number of words of the first form that the words begin with; 0: none."""
    return next((len(form) for form in forms if tuple(words[: len(form)]) == form), 0)


def _step(reading: _Reading, words: list[str]) -> int:
    """Read what the words begin with into the query; the number of words that it took."""
    word, query = words[0], reading.query
    if word in ("not", "no", "non") and (found := longest(words[1:])):
        reading.query = replace(query, other_than=(*query.other_than, found[1]))
        return 1 + found[0]
    if used := _relation(reading, words) or _ranked(reading, words):
        return used
    if word in KINDS or word in SUBJECTS:
        kind = KINDS.get(word, "subject")
        if query.kind == "object" or kind != "subject":
            reading.query = replace(query, kind=kind, plural=query.plural or word.endswith("s"))
        return 1
    if word in PLURAL:
        reading.query = replace(query, plural=True, count=COUNTS.get(word, 0))
        return 1
    if word in SMALL | LARGE:
        size = -1 if word in SMALL else 1
        reading.query = replace(query, size=size, upright=word in UPRIGHT)
        return 1
    if word in SKIPPED or (word in ("and", "with", "in", "at", "to", "from") and len(words) > 1):
        return 1
    if found := longest(words):
        reading.query = replace(query, colors=(*query.colors, found[1]))
        return found[0]
    reading.nouns.append(word)
    return 1


def _relation(reading: _Reading, words: list[str]) -> int:
    """Read a relation and all that follows it; 0 where the words begin with none."""
    for form, relation in RELATIONS:
        rest = words[len(form) :]
        if tuple(words[: len(form)]) != form or not rest:
            continue
        if relation == "on" and [w for w in rest if w not in SKIPPED][:1] and _side(rest):
            return 0
        if relation == "beside" and len(form) == 1 and form[0] == "nearest":
            return 0
        split = rest.index("and") if relation == "between" and "and" in rest else None
        ends = [rest[:split], rest[split + 1 :]] if split is not None else [rest]
        query = reading.query
        if relation == "beside" and not [w for w in rest if w not in SKIPPED]:
            reading.query = replace(query, order="front")  # "nearest to the camera"
            return len(words)
        told = (relation, tuple(_query(each) for each in ends if each))
        reading.query = replace(query, relations=(*query.relations, told))
        return len(words)
    return 0


def _side(words: list[str]) -> tuple[int, Key] | None:
    """(words used, side) of "the left", "left side", "the very back"."""
    for at, word in enumerate(words[:3]):
        if word in SIDES:
            after = words[at + 1 : at + 2]
            return at + 1 + (after in (["side"], ["end"], ["edge"])), SIDES[word]
        if word not in ("the", "very", "far", "its"):
            return None
    return None


def _ranked(reading: _Reading, words: list[str]) -> int:
    """Read a superlative, an ordinal or a side; 0 where the words begin with none."""
    word, query = words[0], reading.query
    if word in MOST:
        key, place = MOST[word]
        if query.place and query.order is None:  # "second largest"
            place = query.place if place == 0 else place - query.place
        reading.query = replace(query, order=key, place=place)
        return 1
    if word in ORDINALS:
        reading.query = replace(query, place=ORDINALS[word])
        return 1
    if word in ("from", "on", "at", "in", "to") and (side := _side(words[1:])):
        used, key = side
        if words[1 + used : 2 + used] == ["of"]:
            return 0
        reading.query = replace(query, order=key)
        return 1 + used
    if word in SIDES:
        if words[1:2] == ["of"]:
            return 0
        reading.query = replace(query, order=SIDES[word])
        return 1
    return 0
