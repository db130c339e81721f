"""Words that a sentence is read by, from `lexicon.txt`: meanings by phrase."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).with_name("lexicon.txt")
THINGS = TABLE.with_name("things.txt")
STYLES = TABLE.with_name("styles.txt")
LONGEST = 5
"""Most words of a phrase."""


class Entry(NamedTuple):
    """Meaning of a phrase."""

    kind: str
    value: str


def rows_of(table: Path) -> list[tuple[str, str, list[str]]]:
    """(kind, value, phrases) of each row of a table of words."""
    rows = []
    for line in table.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("# "):
            head, _, phrases = line.partition(":")
            kind, _, value = head.partition(" ")
            rows.append(
                (kind, value, [each.strip() for each in phrases.split(",") if each.strip()])
            )
    return rows


def names(kind: str) -> frozenset[str]:
    """Names of a kind in `lexicon.txt`, as light or scenery: each has a painter of its own."""
    return frozenset(value for told, value, _ in rows_of(TABLE) if told == kind)


def things(kind: str) -> dict[str, str]:
    """Values by the phrases of a kind in `things.txt`, in the order of its rows."""
    rows = (row for row in rows_of(THINGS) if row[0] == kind)
    return {phrase: value for _, value, phrases in rows for phrase in phrases}


SETS = (
    "tinge", "thing", "time", "adj", "trim", "paint", "made", "foreign", "too", "lack", "mend",
    "act", "drawn", "flaw", "cure", "shade", "emits",
)  # fmt: skip
"""Kinds that tell more of a phrase, whatever else it means."""


DRAWN = ("scenery", "unclear")
"""Kinds of looks: those that Gaussians take, and those that are refused."""


@lru_cache(1)
def entries() -> dict[str, Entry]:
    """Meanings by phrase; of a phrase of two rows, the later one's."""
    table = dict[str, Entry]()
    for kind, value, phrases in sorted(rows_of(TABLE), key=lambda row: row[0] not in SETS):
        if kind == "material":
            value = value.partition(" #")[0]
            phrases = [value, *phrases]
        told = "fill" if kind in SETS else "look" if kind in DRAWN else kind
        table.update({phrase: Entry(told, value or phrase) for phrase in phrases})
    return table


@lru_cache(1)
def sets() -> dict[str, frozenset[str]]:
    """Phrases by each kind of `SETS`."""
    found: dict[str, frozenset[str]] = dict.fromkeys(SETS, frozenset())
    for kind, _, phrases in rows_of(TABLE):
        if kind in found:
            found[kind] |= set(phrases)
    return found


@lru_cache(1)
def materials() -> dict[str, str]:
    """Base colors, "#rrggbb", by the names of materials."""
    rows = [value.split(" #") for kind, value, _ in rows_of(TABLE) if kind == "material"]
    return {name: f"#{color}" for name, color in rows}


@lru_cache(1)
def shades() -> dict[str, tuple[float, float]]:
    """Step in lightness L* and factor of chroma of each word such as "dark" before a color."""
    rows = [(value.split(), phrases) for kind, value, phrases in rows_of(TABLE) if kind == "shade"]
    return {each: (float(step), float(chroma)) for (step, chroma), row in rows for each in row}
