"""Words that a sentence is read by, from `lexicon.txt` and `styles.txt`: meanings by phrase."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from gsedit.words.instruction import Change
from gsedit.words.names import LIGHTS, LOOKS, SCENERIES, light_of, named

TABLE = Path(__file__).with_name("lexicon.txt")
THINGS = TABLE.with_name("things.txt")
ALIASES = TABLE.with_name("aliases.txt")
STYLES = LOOKS / "styles.txt"
LONGEST = 5
"""Most words of a phrase."""


class Entry(NamedTuple):
    """Meaning of a phrase."""

    kind: str
    value: str


def lines_of(table: Path) -> Iterator[tuple[str, str, str]]:
    """(kind, value, what is behind the colon) of each row of a table of words or sentences."""
    for line in table.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("# "):
            head, _, told = line.partition(":")
            kind, _, value = head.partition(" ")
            yield kind, value, told.strip()


def rows_of(table: Path) -> list[tuple[str, str, list[str]]]:
    """(kind, value, phrases) of each row of a table of words."""
    return [
        (kind, value, [each.strip() for each in told.split(",") if each.strip()])
        for kind, value, told in lines_of(table)
    ]


@lru_cache(1)
def rows() -> list[tuple[str, str, list[str]]]:
    """(kind, value, phrases) of each row of `lexicon.txt` and each name of looks/*.txt."""
    return [*rows_of(TABLE), *named()]


@lru_cache
def names(kind: str) -> frozenset[str]:
    """Names of a kind: of light, scenery, material and growth each has a painter of its own."""
    return frozenset(value for told, value, _ in rows() if told == kind)


@lru_cache
def things(kind: str) -> dict[str, str]:
    """Values by the phrases of a kind in `things.txt`, in the order of its rows."""
    rows = (row for row in rows_of(THINGS) if row[0] == kind)
    return {phrase: value for _, value, phrases in rows for phrase in phrases}


@lru_cache
def patterns(kind: str) -> list[tuple[str, str]]:
    """(value, pattern) of each row of a kind of patterns in `things.txt`."""
    return [(value, told) for row, value, told in lines_of(THINGS) if row == kind]


def pattern(name: str) -> re.Pattern[str]:
    """The pattern of a name."""
    return re.compile(dict(patterns("pattern"))[name], re.IGNORECASE)


@lru_cache
def spans(kind: str, *more: str) -> str:
    """A pattern of the phrases of a kind of `things.txt` and of more, the longest first."""
    longest = sorted({*things(kind), *more}, key=lambda each: -len(each))
    return "|".join(
        re.escape(each.replace(" 's", "'s")).replace(r"\ ", "[ -]+") for each in longest
    )


def looks() -> dict[str, tuple[str, ...]]:
    """Names of all that a scene can look like, by kind: material, light, scenery, style."""
    kinds = ("material", "light", "scenery")
    found = {kind: tuple(dict.fromkeys(v for k, v, _ in named() if k == kind)) for kind in kinds}
    return {**found, "style": tuple(styles())}


SETS = (
    "tinge", "thing", "adj", "trim", "paint", "made", "foreign", "too", "lack", "mend",
    "act", "drawn", "flaw", "cure", "shade",
)  # fmt: skip
"""Kinds that tell more of a phrase, whatever else it means."""


@lru_cache(1)
def styles() -> dict[str, int]:
    """Numbers of the painter's styles by their names."""
    rows = (value.rpartition(" ") for kind, value, _ in rows_of(STYLES) if kind == "style")
    return {name: int(number) for name, _, number in rows}


def phrases_of_styles() -> dict[str, list[str]]:
    """Phrases that ask for each style of the painter, by its name."""
    rows = rows_of(STYLES)
    return {value.rpartition(" ")[0]: phrases for kind, value, phrases in rows if kind == "style"}


@lru_cache(1)
def style_words() -> dict[str, str]:
    """Names of styles by the phrases that ask for them, the names among these."""
    asked = phrases_of_styles().items()
    return {name: name for name in styles()} | {each: name for name, row in asked for each in row}


@lru_cache(1)
def near_styles() -> dict[str, list[str]]:
    """Names of the styles that are nearest to each look that none resembles."""
    return {value: phrases for kind, value, phrases in rows_of(STYLES) if kind == "near"}


@lru_cache(1)
def entries() -> dict[str, Entry]:
    """Meanings by phrase; of a phrase of two rows, the later one's. Names of painting styles win
    over all else, and all else over the other phrases that ask for one."""
    table = {phrase: Entry("look", name) for phrase, name in style_words().items()}
    for kind, value, phrases in rows_of(ALIASES):
        told = "look" if kind == "scenery" else kind
        table |= {phrase: Entry(told, value) for phrase in phrases if phrase not in table}
    for kind, value, phrases in sorted(rows(), key=lambda row: row[0] not in SETS):
        if kind == "growth":  # read where a layer is asked for
            continue
        told = "fill" if kind in SETS else "look" if kind == "scenery" else kind
        table.update({phrase: Entry(told, value or phrase) for phrase in phrases})
    return table | {name: Entry("look", name) for name in styles()}


@lru_cache(1)
def sets() -> dict[str, frozenset[str]]:
    """Phrases by each kind of `SETS`."""
    found: dict[str, frozenset[str]] = dict.fromkeys(SETS, frozenset())
    for kind, _, phrases in rows_of(TABLE):
        if kind in found:
            found[kind] |= set(phrases)
    return found


@lru_cache(1)
def shades() -> dict[str, tuple[float, float]]:
    """Step in lightness L* and factor of chroma of each word such as "dark" before a color."""
    rows = [(value.split(), phrases) for kind, value, phrases in rows_of(TABLE) if kind == "shade"]
    return {each: (float(step), float(chroma)) for (step, chroma), row in rows for each in row}


LIKE = "the given picture"
"""Name of the style of a picture that is given beside the sentence."""


def routed(change: Change) -> Change:
    """A change with the route that does it: an editor of any sentence where none here does."""
    if change.kind in ("tone", "paint", "material"):
        return replace(change, route=change.kind)
    if change.kind in ("object", "growth"):
        return replace(change, route="object")
    if change.kind == "light" and light_of(change.name) in LIGHTS:
        return replace(change, route="light")
    if change.kind == "look" and change.name in SCENERIES:
        return replace(change, route="scenery")
    drawn = change.kind == "look" and (change.name == LIKE or change.name in styles())
    return replace(change, route="style" if drawn else "pix2pix")
