"""Tables, in text files, of what a sentence can name: materials, lights.

A row is a name and its values: `key=0.5`, `key=0.5,0.7,1`, `key=#ffc65a`, `key=yes`. Indented rows
below it are its parts. `[section]` begins a section, and # a comment.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple


class Row(NamedTuple):
    """The values of a name, and its parts in order."""

    values: dict[str, Any]
    parts: list[tuple[str, dict[str, Any]]]


def read_table(path: Path) -> dict[str, dict[str, Row]]:
    """The rows by section and name."""
    sections: dict[str, dict[str, Row]] = {}
    rows, parts = {}, []
    for line in path.read_text("utf-8").splitlines():
        if line.startswith("["):
            rows = sections.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            words = [word for word in line.split() if "=" not in word]
            pairs = (word.split("=") for word in line.split() if "=" in word)
            name, values = " ".join(words), {key: _value(text) for key, text in pairs}
            if line.startswith(" "):
                parts.append((name, values))
            else:
                rows[name] = Row(values, parts := [])
    return sections


def _value(text: str) -> str | bool | float | tuple[float, ...]:
    if text == "yes" or text.startswith("#"):
        return text == "yes" or text
    numbers = tuple(map(float, text.split(",")))
    return numbers if "," in text else numbers[0]
