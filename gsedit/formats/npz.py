"""A scene as numpy's .npz: the arrays of `SplatTable`, exactly, to be read without gsedit.

Keys: `means` (n,3), `quats` (n,4) wxyz, `log_scales` (n,3), `logit_opacities` (n,), `sh` (n,k,3),
all float32; `extra/NAME` (n,) for each extra column; `elements/NAME` for other tables; `comments`,
a line each, and `antialiased` if the scene is so. Members are not compressed, nothing is pickled.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import isqrt, prod
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryFile
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.lib import format as npy

from gsedit.errors import InputError
from gsedit.formats.streams import (
    AT_ONCE,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
)
from gsedit.scene.table import SPLAT_FIELDS, SplatTable

EXTRA, ELEMENTS = "extra/", "elements/"
_TAILS = {"means": (3,), "quats": (4,), "log_scales": (3,), "logit_opacities": ()}
MOST_PACKED = 100
"""How many times larger than the file its arrays may be: floats pack 10 times at the best."""
_DAMAGED = (
    BadZipFile,
    NotImplementedError,
    OSError,
    ValueError,
    EOFError,
    RuntimeError,
    SyntaxError,
    TokenError,
    zlib.error,
)
Kind = tuple[tuple[int, ...], np.dtype]
"""The shape and the type of an array."""
BESIDE_MAX_BYTES = 16 << 20
"""Largest size of comments and of each other table, bytes: they are read whole."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .npz; its arrays are read in parts. Raises InputError for one that is no scene."""
    with Archive(path) as archive:
        kinds = {name: archive.announced(name) for name in archive.names}
        count, k = _sizes(path, kinds)
        extra = {
            name.removeprefix(EXTRA): kind
            for name, (shape, kind) in kinds.items()
            if name.startswith(EXTRA) and shape == (count,) and kind.kind in "iufb"
        }
        beside = {
            name: archive.whole(name)
            for name, kind in kinds.items()
            if _is_element(name, *kind) or name in ("comments", "antialiased")
        }
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


def _sizes(path: Path, kinds: dict[str, Kind]) -> tuple[int, int]:
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


class Archive:
    """The arrays of a .npz, each announced first and then read in parts or whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._readable():
            self.zip = ZipFile(path)
        sizes = sum(info.file_size for info in self.zip.infolist())
        if sizes > MOST_PACKED * path.stat().st_size:
            raise self._error(f"it would unpack to {sizes / 1e9:.3g} GB")

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *_: object) -> None:
        self.zip.close()

    @property
    def names(self) -> list[str]:
        return [n.removesuffix(".npy") for n in self.zip.namelist() if n.endswith(".npy")]

    def announced(self, name: str) -> Kind:
        """The shape and type of an array."""
        with self._readable(), self.zip.open(f"{name}.npy") as member:
            shape, kind = self._header(member)
            size = self.zip.getinfo(f"{name}.npy").file_size - member.tell()
        if size != prod(shape) * kind.itemsize:
            raise self._error(f"{name} has {size} bytes for shape {shape}")
        return shape, kind

    def parts(self, name: str, rows: int) -> Iterator[np.ndarray]:
        """An array in parts of some rows."""
        with ExitStack() as stack:
            with self._readable():
                member = stack.enter_context(self.zip.open(f"{name}.npy"))
                shape, kind = self._header(member)
            for start in range(0, shape[0], rows):
                part = (min(rows, shape[0] - start), *shape[1:])
                with self._readable():
                    data = member.read(prod(part) * kind.itemsize)
                    yield np.frombuffer(data, kind).reshape(part)

    def whole(self, name: str) -> np.ndarray:
        """A small array, with at least one axis."""
        shape, kind = self.announced(name)
        if prod(shape) * kind.itemsize > BESIDE_MAX_BYTES:
            raise self._error(f"{name} is larger than {BESIDE_MAX_BYTES >> 20} MiB")
        with self._readable(), self.zip.open(f"{name}.npy") as member:
            self._header(member)
            return np.atleast_1d(np.frombuffer(member.read(), kind).reshape(shape))

    def _header(self, member: Any) -> Kind:
        version = npy.read_magic(member)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, fortran, kind = read(member)
        if fortran and len(shape) > 1:
            raise ValueError("an array is stored column by column")
        if kind.hasobject:
            raise ValueError("an array holds pickled objects")
        return shape, kind

    @contextmanager
    def _readable(self) -> Iterator[None]:
        try:
            yield
        except _DAMAGED as error:
            raise self._error(str(error).split("\n")[0]) from None

    def _error(self, reason: str) -> InputError:
        return InputError(f"{self.path} cannot be read as .npz ({reason}): save it again")


def _read(path: Path, header: SceneHeader) -> Blocks:
    keys = {**{name: name for name in SPLAT_FIELDS}, **{n: EXTRA + n for n in header.extra}}
    with Archive(path) as archive:
        streams = [archive.parts(key, AT_ONCE) for key in keys.values()]
        for parts in zip(*streams):
            with np.errstate(over="ignore"):  # a double beyond float32 becomes inf: found later
                fields = [part.astype(np.float32) for part in parts[: len(SPLAT_FIELDS)]]
            extra = dict(zip(header.extra, parts[len(SPLAT_FIELDS) :]))
            yield SplatTable(*fields, extra=extra)


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write the arrays; the number of rows. Each waits in a file beside `path` that has no name,
    as the archive holds one after the other."""
    k = (header.degree + 1) ** 2
    kinds: dict[str, Kind] = {
        **{name: (tail, np.dtype("<f4")) for name, tail in {**_TAILS, "sh": (k, 3)}.items()},
        **{EXTRA + name: ((), np.dtype(kind)) for name, kind in header.extra.items()},
    }
    count = 0
    with ExitStack() as stack:
        spools = {name: stack.enter_context(TemporaryFile(dir=path.parent)) for name in kinds}
        for block in blocks:
            for name, (_, kind) in kinds.items():
                own = block.extra[name.removeprefix(EXTRA)] if EXTRA in name else None
                values = getattr(block, name) if own is None else own
                spools[name].write(np.ascontiguousarray(values, kind).data)
            count += len(block)
        archive = stack.enter_context(ZipFile(path, "w"))
        for name, (tail, kind) in kinds.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                start = {"descr": npy.dtype_to_descr(kind), "fortran_order": False}
                npy.write_array_header_1_0(member, {**start, "shape": (count, *tail)})
                spools[name].seek(0)
                copyfileobj(spools[name], member, 1 << 20)
        for name, values in _beside(header).items():
            with archive.open(f"{name}.npy", "w") as member:
                npy.write_array(member, values, allow_pickle=False)
    return count


def _beside(header: SceneHeader) -> dict[str, np.ndarray]:
    """Arrays of the file that do not have one value a row."""
    arrays = {ELEMENTS + name: rows for name, rows in header.elements.items()}
    if header.comments:
        arrays["comments"] = np.array(
            "\n".join(header.comments)
        )  # as an array, all would be padded
    if header.antialiased:
        arrays["antialiased"] = np.array(True)
    return arrays
