"""Files of JSON lines that grow with the work; metrics.jsonl, with one line an event, is one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

from gsedit.runs.events import Event
from gsedit.runs.json_lines import read_lines, write_line

Record = TypeVar("Record")


def as_record(event: Event) -> dict[str, Any]:
    """The fields of an event that hold something, by name."""
    record = asdict(event)
    return {name: value for name, value in record.items() if value not in (None, "")}


def read_events(path: Path | str) -> list[Event]:
    """The events of a metrics.jsonl. A last line without its newline was cut off: it is left out.

    Raises InputError naming the file and the line where a line is not an event.
    """
    names = ", ".join(each.name for each in fields(Event))
    advice = f"give the metrics.jsonl of an edit, whose lines are objects of {names}"
    return read_lines(path, Event, kind="an event", advice=advice)


@dataclass
class Journal(Generic[Record]):
    """A file of JSON lines that grows with the work: each record is on disk before the next.

    The first record replaces what an earlier run left at `path`; folders are made.
    """

    path: Path
    as_record: Callable[[Record], Any] = lambda record: record
    """Conversion of a record before it is written; NaN and infinity are written as null."""
    records: list[Record] = field(default_factory=list)

    def write(self, record: Record) -> None:
        """Append a record to the file and to `records`."""
        mode = "a" if self.records else "w"
        self.records.append(record)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open(mode, encoding="utf-8") as file:
            write_line(file, self.as_record(record))


def event_journal(path: Path | str, earlier: Iterable[Event] = ()) -> Journal[Event]:
    """The journal of an edit or a fit, as `read_events` reads it.

    With `earlier` events, those of the work before it was interrupted, the file begins anew.
    """
    journal = Journal(Path(path), as_record)
    for event in earlier:
        journal.write(event)
    return journal
