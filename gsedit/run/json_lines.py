"""JSON files of one record, or of one a line, each on disk before the next. Needs no torch."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

from gsedit.run.atomic import atomic_path

Record = TypeVar("Record")


def plain(value: Any) -> Any:
    """A value as JSON can hold it: records and mappings as objects, tuples as arrays, paths and
    whatever else as text, and the numbers that JSON lacks (NaN, infinity) as null."""
    if is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)


def write_record(record: Any, path: Path | str, *, overwrite: bool = False) -> None:
    """Write one record as an indented JSON file. Raises UsageError as `atomic_path` does."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(json.dumps(plain(record), indent=2, allow_nan=False) + "\n")


def write_line(file: IO[str], record: Any) -> None:
    """Append a record as one JSON line and flush it: it survives an interruption."""
    file.write(json.dumps(plain(record), allow_nan=False) + "\n")
    file.flush()


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
