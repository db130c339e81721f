"""Names of materials, lights, weathers and growths, and how they look, each from its table.

A row is a name and its values: `key=0.5`, `key=0.5,0.7,1`, `key=#ffc65a`, `key=yes`, `key=word`.
Indented rows below it are its parts, and other words for it where they begin with a colon.
`[section]` begins a section, and # a comment. Loads no torch.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

KINDS = {"materials": "material", "timbers": "material", "lights": "light",
         "weathers": "scenery", "growths": "growth"}  # fmt: skip
"""Kinds of the names of a section; others name parts and skies."""


class Row(NamedTuple):
    """The values of a name, its parts in order, and other words for it."""

    values: dict[str, Any]
    parts: list[tuple[str, dict[str, Any]]]
    words: list[str]


def read_table(*paths: Path) -> dict[str, dict[str, Row]]:
    """The rows of some files by section and name."""
    sections: dict[str, dict[str, Row]] = {}
    rows, last = {}, Row({}, [], [])
    for line in "\n".join(path.read_text("utf-8") for path in paths).splitlines():
        if line.startswith("["):
            rows = sections.setdefault(line.strip("[]"), {})
        elif line.startswith("  : "):
            words = (each.strip() for each in line[4:].split(","))
            last.words.extend(word for word in words if word)
        elif line and not line.startswith("#"):
            words = [word for word in line.split() if "=" not in word]
            pairs = (word.split("=") for word in line.split() if "=" in word)
            name, values = " ".join(words), {key: _value(text) for key, text in pairs}
            if line.startswith(" "):
                last.parts.append((name, values))
            else:
                last = rows[name] = Row(values, [], [])
    return sections


def _value(text: str) -> str | bool | float | tuple[float, ...]:
    if text in ("yes", "no"):
        return text == "yes"
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        return text
    return numbers if "," in text else numbers[0]


LOOKS = Path(__file__).with_name("looks")
TABLE = read_table(*(LOOKS / f"{n}.txt" for n in ("materials", "lights", "weathers", "growths")))


def named() -> list[tuple[str, str, list[str]]]:
    """(kind, name, phrases that ask for it) of every name, in the order of the table."""
    return [
        (kind, name, [*[name] * row.values.get("alone", True), *row.words])
        for section, kind in KINDS.items()
        for name, row in TABLE[section].items()
    ]


def lights(key: str) -> frozenset[str]:
    """Names of the lights that have a value or a part: `time`, `own`, `sun`, `lamp`."""
    rows = TABLE["lights"].items()
    return frozenset(name for name, row in rows if key in {*row.values, *dict(row.parts)})


LIGHTS, SCENERIES = frozenset(TABLE["lights"]), frozenset(TABLE["weathers"])
"""Names of the lights, and of weather, seasons and drawings."""


def light_of(name: str) -> str:
    """The light that a name such as "sunset from the left" begins with; the name without one."""
    words = name.split()
    starts = (" ".join(words[:end]) for end in range(len(words), 0, -1))
    return next((start for start in starts if start in LIGHTS), name)
