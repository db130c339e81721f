"""JSON files of one record, or of one a line, each on disk before the next. Needs no torch."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import IO, Any, TypeVar

from gsedit.errors import InputError
from gsedit.storage.atomic import atomic_path
from gsedit.storage.inputs import open_regular
from gsedit.storage.json_files import object_of, parse_json

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
        with open_regular(Path(path)) as file:
            text = file.read().decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read ({error}); {advice}") from error
    records = []
    for number, line in enumerate(text.split("\n")[:-1], 1):
        if not line.strip():
            continue
        where = f"{path}, line {number}: not {kind}"
        try:
            records.append(build(**parse_json(line, where, object_of({}), advice=advice)))
        except (ValueError, TypeError) as error:
            raise InputError(f"{where} ({error}); {advice}") from error
    return records
