"""Files of a benchmark: measurements as JSON lines, tables as text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from gsedit.runs.events import Event
from gsedit.runs.journal import Journal
from gsedit.storage.atomic import atomic_path


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, its first column aligned left, the others right."""
    lines = [head, ["---", *("---:" for _ in head[1:])], *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


Measurement = TypeVar("Measurement")


def write_measurements(
    items: Iterable[Event | Measurement], path: Path, measurements: list[Measurement]
) -> Iterator[Event | Measurement]:
    """Pass on events and measurements; each measurement is first appended to the list, and to the
    file as a JSON line, so that an interruption loses none.

    The first measurement replaces a file that is there already.
    """
    journal = Journal(path, records=measurements)
    for item in items:
        if not isinstance(item, Event):
            journal.write(item)
        yield item


def write_text(path: Path, text: str) -> None:
    """Write a text file, all of it or nothing; overwrites."""
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text(text, encoding="utf-8")
