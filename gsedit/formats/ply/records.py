"""Any PLY file as records: ASCII or binary, either byte order, any elements and columns.

The row counts of the header are compared with the size of the file before memory is allocated.
Format: G. Turk, "The PLY Polygon File Format", 1994."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gsedit.errors import InputError
from gsedit.run.inputs import existing_file

_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"half": "f2", "float": "f4", "double": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float16": "f2", "float32": "f4", "float64": "f8"},
}
HEADER_MAX_BYTES = 1 << 20  # 62 columns take 1.5 kB; 1 MB leaves room for long comments
MAX_ELEMENTS, MAX_COLUMNS = 100, 4096
"""Limits of a header. A splat of SH degree 4 has 86 columns, one with learnt features hundreds."""
_CUT_OFF = "it is cut off, copy or export it again"


@dataclass(frozen=True)
class PlyElement:
    """One table of the file, as its header announces it."""

    name: str
    count: int
    columns: tuple[tuple[str, str], ...]
    """(name, type as written); a list column has the type "list"."""
    count_types: tuple[str, ...] = ()
    """The type of the length in front of each list column's values."""

    @property
    def has_lists(self) -> bool:
        return bool(self.count_types)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.columns)

    @property
    def row_bytes(self) -> int:
        """Bytes of a binary row; defined where there are no lists."""
        return self.dtype("=").itemsize

    def dtype(self, byte_order: str) -> np.dtype:
        """One row; defined where there are no lists."""
        return np.dtype([(name, byte_order + _TYPES[kind]) for name, kind in self.columns])

    def min_row_bytes(self, ascii_values: bool) -> int:
        """The fewest bytes that a row can take: in text, one digit and one separator a value."""
        if ascii_values:
            return 2 * len(self.columns)
        kinds = [kind for _, kind in self.columns if kind != "list"] + list(self.count_types)
        return sum(np.dtype(_TYPES[kind]).itemsize for kind in kinds)


@dataclass(frozen=True)
class PlyHeader:
    """The header of a PLY file."""

    format: str
    """ascii, binary_little_endian or binary_big_endian."""
    elements: tuple[PlyElement, ...]
    comments: tuple[str, ...]
    data_offset: int
    """Bytes in front of the first row."""

    def element(self, name: str) -> PlyElement | None:
        return next((e for e in self.elements if e.name == name), None)


def read_ply_header(path: str | Path) -> PlyHeader:
    """The header, checked against the size of the file; InputError if it cannot be right."""
    path = existing_file(path)
    with path.open("rb") as handle:
        header = _parse_header(path, handle)
    _check_size(path, header)
    return header


def element_blocks(path: Path, header: PlyHeader, name: str, at_once: int) -> Iterator[np.ndarray]:
    """The rows of an element as structured arrays of at most `at_once` rows.

    Raises InputError where the element is not there, has list columns, or ends early.
    """
    element = header.element(name)
    if element is None or element.has_lists:
        raise InputError(f"{path}: there is no element {name} without lists: export it again")
    before = header.elements[: header.elements.index(element)]
    dtype = element.dtype(_BYTE_ORDERS[header.format])
    if header.format == "ascii":
        with path.open("rb") as handle:
            handle.seek(header.data_offset)
            lines = islice(
                (line for line in handle if line.strip()), sum(e.count for e in before), None
            )
            for start in range(0, element.count, at_once):
                rows = min(at_once, element.count - start)
                yield _whole(
                    path, element, start, rows, _parsed(path, element, dtype, islice(lines, rows))
                )
        return
    if any(each.has_lists for each in before):
        raise InputError(f"{path}: a list element stands before {name}: export it without faces")
    offset = header.data_offset + sum(each.count * each.row_bytes for each in before)
    for start in range(0, element.count if element.columns else 0, at_once):
        rows, at = min(at_once, element.count - start), offset + start * dtype.itemsize
        yield _whole(path, element, start, rows, np.fromfile(path, dtype, rows, offset=at))


def element_header(row: np.dtype) -> str:
    """The header's lines for the columns of a record type without lists."""
    names = {np.dtype(code): kind for kind, code in reversed(_TYPES.items())}
    return "".join(
        f"property {names[row[name].newbyteorder('=')]} {name}\n" for name in row.names or ()
    )


def other_elements(
    path: Path, header: PlyHeader, name: str, max_bytes: int
) -> tuple[dict[str, np.ndarray], list[str]]:
    """All elements but one, and the names of those that are left out: lists, what lies behind a
    list, and what is larger than `max_bytes`."""
    kept: dict[str, np.ndarray] = {}
    left_out = []
    for i, element in enumerate(header.elements):
        if element.name == name:
            continue
        behind = header.format != "ascii" and any(e.has_lists for e in header.elements[:i])
        lists = behind or element.has_lists
        if lists or not element.columns or element.count * element.row_bytes > max_bytes:
            left_out.append(element.name)
        else:
            parts = list(element_blocks(path, header, element.name, max(element.count, 1)))
            kept[element.name] = parts[0] if parts else np.zeros(0, element.dtype("<"))
    return kept, left_out


def _parse_header(path: Path, handle: BinaryIO) -> PlyHeader:
    if handle.readline(8).strip() != b"ply":
        raise InputError(f"{path} is not a PLY file (its first line is not 'ply'): check the path")
    file_format, comments, elements = "", [], []
    named: set[str] = set()
    while True:
        raw = handle.readline(HEADER_MAX_BYTES)
        if not raw or handle.tell() > HEADER_MAX_BYTES:
            raise InputError(f"{path}: the header has no end_header line: {_CUT_OFF}")
        line = raw.decode("utf-8", errors="replace").strip()  # as comments may be
        match line.split():
            case ["end_header"]:
                break
            case ["format", name, *_] if name in _BYTE_ORDERS:
                file_format = name
            case ["comment" | "obj_info", *_]:
                comments.append(line.partition(" ")[2])
            case ["element", name, count] if count.isdecimal() and len(count) < 20:
                elements.append((name, int(count), [], []))
                named = set()
            case ["property", *column] if elements:
                _add_column(path, elements[-1], named, column)
            case []:
                continue
            case _:
                raise InputError(f"{path}: header line {line[:80]!r} is not PLY: export it again")
        if len(elements) > MAX_ELEMENTS or len(named) > MAX_COLUMNS:
            raise InputError(
                f"{path}: the header has more than {MAX_ELEMENTS} elements, or {MAX_COLUMNS} "
                "columns in one: export it again"
            )
    if not file_format:
        raise InputError(f"{path}: the header has no format line: export it again")
    tables = tuple(PlyElement(n, count, tuple(c), tuple(t)) for n, count, c, t in elements)
    return PlyHeader(file_format, tables, tuple(comments), handle.tell())


def _add_column(
    path: Path,
    element: tuple[str, int, list[tuple[str, str]], list[str]],
    named: set[str],
    words: list[str],
) -> None:
    """Append a column to those of an element (and the type of its length, if it is a list)."""
    _, _, columns, count_types = element
    match words:
        case ["list", count_type, kind, name] if count_type in _TYPES and kind in _TYPES:
            columns.append((name, "list"))
            count_types.append(count_type)
        case [kind, name] if kind in _TYPES:
            columns.append((name, kind))
        case _:
            raise InputError(
                f"{path}: column {' '.join(words)[:80]!r} of element {element[0][:80]} has no type "
                "that PLY knows: export it again"
            )
    if name in named:
        raise InputError(
            f"{path}: element {element[0][:80]} has two columns {name[:80]}: rename one"
        )
    named.add(name)


def _check_size(path: Path, header: PlyHeader) -> None:
    """Raise InputError if the header announces more rows than the file has bytes for.

    A header can ask for a petabyte; Python integers do not overflow here.
    """
    left = path.stat().st_size - header.data_offset
    left += header.format == "ascii"  # the last value needs no separator
    for element in header.elements:
        left -= element.count * element.min_row_bytes(header.format == "ascii")
        if left < 0:
            raise InputError(
                f"{path}: the header promises {element.count} rows of element {element.name}, "
                f"{-left} bytes more than the file has: {_CUT_OFF}"
            )


def _parsed(path: Path, element: PlyElement, dtype: np.dtype, lines: Iterable[bytes]) -> np.ndarray:
    """Rows of text. Raises InputError where they are no numbers of that type."""
    try:
        with warnings.catch_warnings():  # on no rows at all: an InputError follows
            warnings.simplefilter("ignore", UserWarning)
            return np.loadtxt(lines, dtype, comments=None, ndmin=1)
    except (ValueError, OverflowError) as error:
        reason = str(error).split("\n")[0].split(";")[0]  # then follows advice on NumPy's API
        reason = reason.replace("the dtype passed requires", "a row needs")
        raise InputError(f"{path}: element {element.name}: {reason}: export it again") from None


def _whole(path: Path, element: PlyElement, start: int, count: int, rows: np.ndarray) -> np.ndarray:
    """The rows from `start` on. Raises InputError where they are fewer than `count`."""
    if len(rows) < count:
        raise InputError(
            f"{path}: element {element.name} ends after row {start + len(rows)} of "
            f"{element.count}: {_CUT_OFF}"
        )
    return rows
