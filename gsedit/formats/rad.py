"""Spark's .rad: chunks of packed columns, read; of a tree of levels of detail, its leaves.

Each column of a chunk has an encoding of its own: floats, their bytes apart, bytes of a range,
differences of these. A tree has merged Gaussians above the scene's own, which are its leaves. A
file names no axes: they are those of the file that it was made from. Reading holds a chunk.
Source: sparkjsdev/spark, rust/spark-lib/src/rad.rs and splat_encode.rs, version 1.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import partial
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from gsedit.errors import InputError
from gsedit.formats.limits import check_expansion
from gsedit.formats.quantised import log_scales_of, logits_of
from gsedit.formats.streams import Blocks, ReadOptions, SceneHeader, SceneSource, in_blocks
from gsedit.scene.table import SplatTable
from gsedit.storage.inputs import existing_file, file_inside
from gsedit.storage.json_files import list_of, number, object_of, parse_json, text
from gsedit.storage.safe_names import safe_name
from rasterizer.numerics import color_to_sh

_FILE, _CHUNK = b"RAD0", b"RADC"
_JSON_MAX_BYTES = 16 << 20
_MOST_ROWS = 1 << 20
"""Rows of a chunk; Spark's have 65,536."""
_AGAIN = "it is cut off or damaged, copy or export it again"
_SIZE = number(0, 1 << 48, whole=True)
_PLACE = object_of({"offset": _SIZE, "bytes": _SIZE}, {"filename": text()})
_META = object_of(
    {"version": _SIZE, "type": text(), "count": _SIZE, "chunks": list_of(_PLACE)},
)
_COLUMN = object_of(
    {"offset": _SIZE, "bytes": _SIZE, "property": text(), "encoding": text()},
    {"compression": text(), "min": number(-1e30, 1e30), "max": number(-1e30, 1e30)},
)
_CHUNK_META = object_of(
    {"count": number(0, _MOST_ROWS, whole=True), "properties": list_of(_COLUMN)}
)
_BANDS = {"sh1": 9, "sh2": 15, "sh3": 21}
_WIDTHS = {"center": 3, "alpha": 1, "rgb": 3, "scales": 3, "orientation": 3, "child_count": 1,
           "sh_label": 1, **_BANDS}  # fmt: skip
"""Numbers a row of each column; an orientation has x, y and z of a quaternion, or their codes."""
_BYTES = {"f32": 4, "f32_lebytes": 4, "u32": 4, "f16": 2, "f16_lebytes": 2, "ln_f16": 2, "u16": 2,
          "r8": 1, "r8_delta": 1, "s8": 1, "s8_delta": 1, "ln_0r8": 1, "oct88r8": 1}  # fmt: skip


@dataclass(frozen=True)
class _Chunk:
    """Rows of the scene: where their columns are."""

    path: Path
    start: int
    """Byte of the file where the columns begin."""
    size: int
    """Bytes from there that the chunk has."""
    count: int
    columns: dict[str, dict[str, Any]]

    def bytes(self, name: str, rows: int | None) -> bytes:
        """A column unpacked: of so many rows, or of as many as it has. Raises InputError."""
        column = self.columns[name]
        packed, where = column["bytes"], f"{self.path}: its {name}"
        if column["offset"] + packed > self.size:
            raise InputError(f"{where} are beyond the end of their chunk: {_AGAIN}")
        row = _BYTES.get(column["encoding"], 0) * _WIDTHS[name.removesuffix("_code")]
        if not row:
            raise InputError(
                f"{where} are encoded as {column['encoding'][:40]!r}, unknown: {_AGAIN}"
            )
        most = row * (_MOST_ROWS if rows is None else rows)
        if rows is not None:
            check_expansion(self.path, packed, most)
        with self.path.open("rb") as file:
            file.seek(self.start + column["offset"])
            data = file.read(packed)
        if column.get("compression") == "gz":
            data = _inflated(data, most + 1, where)
        if len(data) > most or len(data) % row or (rows is not None and len(data) < most):
            raise InputError(f"{where} have {len(data)} bytes, {most} are needed: {_AGAIN}")
        return data

    def numbers(self, name: str, rows: int | None = -1) -> Float32[np.ndarray, "n w"]:
        """A column as numbers, of the chunk's rows unless told. Raises InputError."""
        column = self.columns[name]
        data = self.bytes(name, self.count if rows == -1 else rows)
        width = _WIDTHS[name.removesuffix("_code")]
        least, most = column.get("min", 0.0), column.get("max", 1.0)
        values = _decoded(np.frombuffer(data, np.uint8), column["encoding"], width, least, most)
        return np.ascontiguousarray(values.T, np.float32)

    @property
    def leaves(self) -> Bool[np.ndarray, " n"] | None:
        """Rows that are the scene's own; None where all are."""
        return None if "child_count" not in self.columns else self.numbers("child_count")[:, 0] == 0


def _inflated(data: bytes, most: int, where: str) -> bytes:
    """Unpack raw deflate, which the writers call gz, or gzip; `most` bytes of it at most."""
    try:
        return zlib.decompressobj(31 if data[:2] == b"\x1f\x8b" else -15).decompress(data, most)
    except zlib.error as error:
        raise InputError(f"{where} do not unpack ({error}): {_AGAIN}") from None


def _decoded(
    data: UInt8[np.ndarray, " b"], encoding: str, width: int, least: float, most: float
) -> np.ndarray:
    """Numbers (w, n) of a column; scales in bytes or ln_f16 are logarithms, as they are stored."""
    if encoding in ("f32_lebytes", "f16_lebytes"):
        planes = np.ascontiguousarray(data.reshape(_BYTES[encoding], -1).T)
        return planes.view("<f4" if encoding[1:3] == "32" else "<f2").reshape(width, -1)
    kind = {"f32": "<f4", "u32": "<u4", "f16": "<f2", "ln_f16": "<f2", "u16": "<u2"}.get(encoding)
    if kind is not None:
        return data.view(kind).reshape(width, -1)
    steps = data.reshape(width, -1)
    if encoding.endswith("_delta"):
        steps = np.add.accumulate(steps, axis=1, dtype=np.uint8)
    if encoding.startswith("s8"):
        return steps.view(np.int8) * (np.float32(most) / 127)
    if encoding == "ln_0r8":
        logs = least + (steps.astype(np.float32) - 1) * (most - least) / 254
        return np.where(steps == 0, np.log(np.finfo(np.float32).tiny), logs)
    return least + steps.astype(np.float32) * (most - least) / 255


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .rad. Raises InputError for one that cannot be right, or whose chunks are missing."""
    data, start = _json(path, 0, _FILE)
    meta = parse_json(data, path, _META, advice=_AGAIN)
    if meta["version"] != 1 or meta["type"] != "gsplat":
        raise InputError(f"{path} is RAD {meta['version']} of {meta['type'][:20]}: gsedit reads 1")
    chunks = [_chunk(path, start, each) for each in meta["chunks"]]
    for file in {chunk.path for chunk in chunks}:
        told = sum(chunk.size for chunk in chunks if chunk.path == file)
        if told > file.stat().st_size:  # one chunk many times would fill the memory
            raise InputError(f"{path}: its chunks overlap in {file.name}: {_AGAIN}")
    if sum(chunk.count for chunk in chunks) != meta["count"]:
        raise InputError(
            f"{path}: its chunks have not the {meta['count']} rows it states: {_AGAIN}"
        )
    count, inner = 0, 0
    for chunk in chunks:
        leaves = chunk.leaves
        own = chunk.count if leaves is None else int(leaves.sum())
        count, inner = count + own, inner + chunk.count - own
    codes = next((chunk for chunk in chunks if "sh1_code" in chunk.columns), None)
    degree = max((_degree(chunk, codes) for chunk in chunks), default=0)
    notes = (f"merged Gaussians of coarser levels left out: {inner:,}",) * bool(inner)
    blocks = partial(_blocks, chunks, codes, degree)
    return SceneSource(path, ".rad", SceneHeader(degree), count, blocks, notes)


def _json(path: Path, at: int, magic: bytes) -> tuple[bytes, int]:
    """The JSON that follows a magic and its length; the byte where it ends, padding included."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(at)
        head = file.read(8)
        length = struct.unpack("<I", head[4:])[0] if len(head) == 8 else 0
        if head[:4] != magic or not 0 < length <= min(_JSON_MAX_BYTES, size - at - 8):
            raise InputError(f"{path} has no {magic.decode()} at byte {at}: {_AGAIN}")
        return file.read(length), at + 8 + -(-length // 8) * 8


def _chunk(path: Path, start: int, place: dict[str, Any]) -> _Chunk:
    """A chunk of the file, or in a file beside it. Raises InputError."""
    if "filename" in place:
        name = safe_name(place["filename"], str(path))
        try:
            path = existing_file(file_inside(path.parent, name, str(path)))
        except InputError as error:
            raise InputError(f"{path} names a file: {error}") from None
        start = 0
    at = start + place["offset"]
    data, columns_at = _json(path, at, _CHUNK)
    meta = parse_json(data, path, _CHUNK_META, advice=_AGAIN)
    columns = {column["property"]: column for column in meta["properties"]}
    missing = [n for n in ("center", "alpha", "rgb", "scales", "orientation") if n not in columns]
    if missing:
        raise InputError(f"{path}: a chunk has no {missing[0]}: {_AGAIN}")
    size = min(at + place["bytes"], path.stat().st_size) - columns_at - 8
    return _Chunk(path, columns_at + 8, size, meta["count"], columns)


def _degree(chunk: _Chunk, codes: _Chunk | None) -> int:
    """Bands of spherical harmonics that a chunk has, in columns or by labels."""
    columns = set(chunk.columns)
    if codes is not None and "sh_label" in chunk.columns:
        columns |= {name.removesuffix("_code") for name in codes.columns}
    return next((d - 1 for d in (1, 2, 3) if f"sh{d}" not in columns), 3)


def _blocks(chunks: list[_Chunk], codes: _Chunk | None, degree: int) -> Blocks:
    palette = None
    if codes is not None:
        bands = [codes.numbers(f"{name}_code", None) for name in [*_BANDS][:degree]]
        if len({len(band) for band in bands}) > 1:
            raise InputError(f"{codes.path}: its SH codes have different lengths: {_AGAIN}")
        palette = np.concatenate(bands, 1) if bands else None
    for chunk in chunks:
        yield from in_blocks(_rows(chunk, palette, degree))


def _rows(chunk: _Chunk, palette: Float32[np.ndarray, "p m"] | None, degree: int) -> SplatTable:
    """The rows of a chunk that are the scene's own."""
    rest = np.zeros((chunk.count, 3 * ((degree + 1) ** 2 - 1)), np.float32)
    if palette is not None and "sh_label" in chunk.columns:
        labels = chunk.numbers("sh_label")[:, 0].astype(np.intp)
        if len(labels) and labels.max() >= len(palette):
            raise InputError(
                f"{chunk.path}: a row has SH code {labels.max()} of {len(palette)}: {_AGAIN}"
            )
        rest = palette[labels]
    else:
        at = 0
        for name in [*_BANDS][: _degree(chunk, None)]:
            rest[:, at : at + _BANDS[name]] = chunk.numbers(name)
            at += _BANDS[name]
    scales = chunk.numbers("scales")
    if chunk.columns["scales"]["encoding"] == "f32":
        scales = log_scales_of(scales)
    sh = np.concatenate((color_to_sh(chunk.numbers("rgb")), rest), 1)
    opacities = np.minimum(chunk.numbers("alpha")[:, 0], 1)  # above are merged ones, or a rounding
    table = SplatTable(
        chunk.numbers("center"),
        _quats(chunk),
        scales,
        logits_of(opacities),
        sh.reshape(len(sh), -1, 3),
    )
    leaves = chunk.leaves
    return table if leaves is None else table[leaves]


def _quats(chunk: _Chunk) -> Float32[np.ndarray, "n 4"]:
    """Rotations wxyz: from x, y and z with w not negative, or from an axis and an angle.

    The axis is a point of an octahedron, unfolded into a square of 255 steps a side; the angle has
    255 steps of half a turn.
    """
    if chunk.columns["orientation"]["encoding"] != "oct88r8":
        xyz = chunk.numbers("orientation")
        with np.errstate(over="ignore", invalid="ignore"):
            w = np.sqrt((1 - np.square(xyz).sum(1, keepdims=True)).clip(0))
        return np.concatenate((w, xyz), 1)
    codes = np.frombuffer(chunk.bytes("orientation", chunk.count), np.uint8).reshape(-1, 3)
    flat = codes[:, :2].astype(np.float32) / 255 * 2 - 1
    z = 1 - np.abs(flat).sum(1, keepdims=True)
    flat -= np.copysign((-z).clip(0), flat)
    axis = np.concatenate((flat, z), 1)
    half = codes[:, 2:].astype(np.float32) * np.float32(pi / 510)
    axis *= np.sin(half) / np.linalg.norm(axis, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), axis), 1)
