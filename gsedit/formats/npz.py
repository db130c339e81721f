"""A scene as numpy's .npz: the arrays of `SplatTable`, exactly, to be read without gsedit.

Keys: `means` (n,3), `quats` (n,4) wxyz, `log_scales` (n,3), `logit_opacities` (n,), `sh` (n,k,3),
all float32; `extra/NAME` (n,) for each extra column; `elements/NAME` for other tables; `comments`,
a line each, and `antialiased` if the scene is so. Members are not compressed, nothing is pickled.
Reading and writing hold the scene.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import isqrt, prod
from pathlib import Path
from tokenize import TokenError
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.lib import format as npy

from gsedit.errors import InputError
from gsedit.formats.streams import (
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
    gather,
    in_blocks,
)
from gsedit.scene.table import SPLAT_FIELDS, SplatTable

EXTRA, ELEMENTS = "extra/", "elements/"
_TAILS = {"means": (3,), "quats": (4,), "log_scales": (3,), "logit_opacities": ()}
MOST_PACKED = 100
"""How many times larger than the file its arrays may be: floats pack 10 times at the best."""
_DAMAGED = (
    *(BadZipFile, NotImplementedError, OSError, ValueError, EOFError, RuntimeError),
    *(SyntaxError, TokenError, KeyError, zlib.error),
)
"""Errors that numpy and zipfile raise for damaged archives."""
Kind = tuple[tuple[int, ...], np.dtype]
"""The shape and the type of an array."""
BESIDE_MAX_BYTES = 16 << 20
"""Largest size of comments and of each other table, bytes."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .npz. Raises InputError for one that is no scene."""
    kinds = _announced(path)
    count, k = _sizes(path, kinds)
    extra = {
        name.removeprefix(EXTRA): kind
        for name, (shape, kind) in kinds.items()
        if name.startswith(EXTRA) and shape == (count,) and kind.kind in "iufb"
    }
    chosen = [
        name
        for name, kind in kinds.items()
        if _is_element(name, *kind) or name in ("comments", "antialiased")
    ]
    beside = _arrays(path, chosen)
    large = [name for name, rows in beside.items() if rows.nbytes > BESIDE_MAX_BYTES]
    if large:
        raise InputError(f"{path}: {large[0]} is larger than {BESIDE_MAX_BYTES >> 20} MiB: cut it")
    known = {*SPLAT_FIELDS, *beside, *(EXTRA + name for name in extra)}
    unknown = [name for name in kinds if name not in known]
    header = SceneHeader(
        isqrt(k) - 1,
        extra,
        tuple(c for text in beside.pop("comments", ()) for c in str(text).split("\n")),
        antialiased=bool(beside.pop("antialiased", np.zeros(0, bool)).any()),
        elements={name.removeprefix(ELEMENTS): rows for name, rows in beside.items()},
    )
    notes = (f"arrays left out: {', '.join(unknown)}",) if unknown else ()
    return SceneSource(path, ".npz", header, count, lambda: _read(path, header), notes)


def _is_element(name: str, shape: tuple[int, ...], kind: np.dtype) -> bool:
    """Whether it is a table of plain numbers, whose own name and those of its columns are words."""
    columns = [kind[column] for column in kind.names or ()]
    words = (name.removeprefix(ELEMENTS), *(kind.names or ()))
    plain = bool(columns) and all(each.kind in "iuf" and each.itemsize <= 8 for each in columns)
    named = words[0] != "vertex" and all(word.split() == [word] for word in words)
    return name.startswith(ELEMENTS) and len(shape) == 1 and plain and named


def _announced(path: Path) -> dict[str, Kind]:
    """The arrays as their headers announce them. Raises InputError where the file is damaged, or
    unpacks to more, or to less, than that."""
    kinds = {}
    with _readable(path), ZipFile(path) as archive:
        sizes = sum(info.file_size for info in archive.infolist())
        if sizes > MOST_PACKED * path.stat().st_size:
            raise ValueError(f"it would unpack to {sizes / 1e9:.3g} GB")
        for info in archive.infolist():
            if not info.filename.endswith(".npy"):
                continue
            with archive.open(info) as member:
                version = npy.read_magic(member)
                read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
                shape, _, kind = read(member)
                size = info.file_size - member.tell()
            if kind.hasobject:
                raise ValueError("an array holds pickled objects")
            if size != prod(shape) * kind.itemsize:
                raise ValueError(f"{info.filename} has {size} bytes for shape {shape}")
            kinds[info.filename.removesuffix(".npy")] = shape, kind
    return kinds


def _sizes(path: Path, kinds: Mapping[str, Kind]) -> tuple[int, int]:
    """n and k of the arrays; InputError where they are not those of a scene."""
    missing = [name for name in SPLAT_FIELDS if name not in kinds]
    if missing:
        raise InputError(
            f"{path} has no array {', '.join(missing)}: a scene has {', '.join(SPLAT_FIELDS)}"
        )
    count = (*kinds["means"][0], 0)[0]
    k = (*kinds["sh"][0], 0, 0)[1]
    k = k if k in (1, 4, 9, 16, 25) else 1
    for name, tail in {**_TAILS, "sh": (k, 3)}.items():
        shape, kind = kinds[name]
        if shape != (count, *tail) or kind.kind != "f":
            raise InputError(
                f"{path}: {name} is {kind} of shape {shape}, not float32 of {(count, *tail)}: "
                "save it again"
            )
    return count, k


def _arrays(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    """Some arrays, with at least one axis each."""
    with _readable(path), np.load(path, allow_pickle=False) as arrays:
        return {name: np.atleast_1d(arrays[name]) for name in names}


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except _DAMAGED as error:
        reason = str(error).split("\n")[0]
        raise InputError(f"{path} cannot be read as .npz ({reason}): save it again") from None


def _read(path: Path, header: SceneHeader) -> Blocks:
    arrays = _arrays(path, [*SPLAT_FIELDS, *(EXTRA + name for name in header.extra)])
    with np.errstate(over="ignore"):  # a double beyond float32 becomes inf: found later
        fields = [arrays[name].astype(np.float32, "C", copy=False) for name in SPLAT_FIELDS]
    extra = {name: arrays[EXTRA + name] for name in header.extra}
    yield from in_blocks(SplatTable(*fields, extra=extra))


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write the arrays; the number of rows."""
    table = gather(blocks, header, 0)
    arrays = {name: getattr(table, name) for name in SPLAT_FIELDS}
    arrays |= {EXTRA + name: column for name, column in table.extra.items()}
    arrays |= {ELEMENTS + name: rows for name, rows in header.elements.items()}
    if header.comments:  # in one text: as an array, all would be padded
        arrays["comments"] = np.array("\n".join(header.comments))
    if header.antialiased:
        arrays["antialiased"] = np.array(True)
    with path.open("wb") as file:
        np.savez(file, **arrays)
    return len(table)
