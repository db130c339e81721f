"""JSON files of one record, or of one a line, each on disk before the next. Needs no torch."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import IO, Any, TypeVar

from gsedit.errors import InputError
from gsedit.files.atomic import atomic_path

Record = TypeVar("Record")


def plain(value: Any) -> Any:
    """A value as JSON can hold it: records and mappings as objects, tuples as arrays, paths and
    whatever else as text, and the numbers that JSON lacks (NaN, infinity) as null.
    """
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
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


def read_lines(
    path: Path | str, build: Callable[..., Record], *, kind: str, advice: str
) -> list[Record]:
    """The records of a file, each `build(**object)` of a line. Empty lines are left out, and so is
    a last line without its newline: an interruption cut it off.

    Raises InputError naming the file, the line that is not `kind` ("an event"), and the `advice`.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); {advice}") from error
    records = []
    for number, line in enumerate(text.split("\n")[:-1], 1):
        if not line.strip():
            continue
        try:
            records.append(build(**json.loads(line)))
        except (ValueError, TypeError) as error:
            raise InputError(f"{path}, line {number}: not {kind} ({error}); {advice}") from error
    return records
