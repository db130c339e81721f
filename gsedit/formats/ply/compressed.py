"""PlayCanvas' .compressed.ply: chunks of 256 Gaussians, 16 bytes each and one a SH coefficient.

A chunk holds the least and greatest x y z, log scale and color of its Gaussians (files of 2023
have no colors: 12 numbers); a Gaussian holds where it is between them. Format: PlayCanvas,
"Compressed PLY Format", developer.playcanvas.com.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import isqrt
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, UInt8, UInt32

from gsedit.errors import InputError
from gsedit.formats.ply.records import (
    PlyElement,
    PlyHeader,
    element_blocks,
    element_header,
    read_ply_header,
)
from gsedit.formats.quantised import bytes_of, from_smallest_three, logits_of, smallest_three
from gsedit.formats.streams import AT_ONCE, Blocks, ReadOptions, SceneHeader, SceneSource, gather
from gsedit.scene.neighbors import morton_order
from gsedit.scene.table import SplatTable
from rasterizer.numerics import color_to_sh

CHUNK = 256
SCALE_LIMIT = 20.0
"""Largest log scale, as in PlayCanvas' writer: one stray row would coarsen its whole chunk."""
_REST = "sh bytes"
SH_RANGE = 8.0
"""SH coefficients are stored in [-4, 4]."""
_BOUNDS = tuple(
    f"{end}_{name}"
    for names in (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b"))
    for end in ("min", "max")
    for name in names
)
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_REST_COUNTS = (0, 9, 24, 45)
_POSITION_BITS = ((21, 11), (11, 10), (0, 11))
"""(shift, bits) of x, y, z; scales are packed alike."""


def is_compressed(header: PlyHeader) -> bool:
    """Whether this PLY has PlayCanvas' packed layout, whatever the file's name."""
    vertex = header.element("vertex")
    return vertex is not None and "packed_position" in vertex.names


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .compressed.ply. Raises InputError for one that is not whole."""
    header = read_ply_header(path)
    count, rest = _counts(path, header)
    scene = SceneHeader(isqrt(1 + rest // 3) - 1, comments=header.comments)
    known = {"chunk", "vertex", "sh"}
    others = [e.name for e in header.elements if e.name not in known]
    beside = [n for e in header.elements if e.name in known for n in e.names if not _expected(n)]
    notes = [f"elements left out: {', '.join(others)}"] * bool(others)
    notes += [f"columns left out: {', '.join(beside)}"] * bool(beside)
    blocks = partial(_read, path, header, rest)
    return SceneSource(path, ".compressed.ply", scene, count, blocks, tuple(notes))


def _counts(path: Path, header: PlyHeader) -> tuple[int, int]:
    """The number of Gaussians, and of SH coefficients beyond the DC term in the three channels
    together; InputError where the elements do not fit."""
    empty = PlyElement("", 0, ())
    chunk, vertex, sh = (header.element(name) or empty for name in ("chunk", "vertex", "sh"))
    missing = [c for c in _BOUNDS[:12] if c not in chunk.names]
    missing += [c for c in _PACKED if c not in vertex.names]
    if missing:
        raise InputError(f"{path}: columns {', '.join(missing)} are missing: export it again")
    columns = [column for e in (chunk, vertex, sh) for column in e.columns]
    wrong = [n for n, kind in columns if _expected(n) and kind not in _expected(n)]
    if wrong:
        raise InputError(f"{path}: columns {', '.join(wrong)} have a wrong type: export it again")
    if chunk.count * CHUNK < vertex.count:
        raise InputError(
            f"{path}: {chunk.count} chunks of {CHUNK} are too few for {vertex.count} Gaussians: "
            "export it again"
        )
    rest = sum(name.startswith("f_rest_") for name in sh.names)
    names = {f"f_rest_{i}" for i in range(rest)}
    if rest not in _REST_COUNTS or names - set(sh.names) or (rest and sh.count < vertex.count):
        raise InputError(
            f"{path}: its {sh.count} rows of {rest} f_rest columns are no SH of "
            f"{vertex.count} Gaussians: export it again"
        )
    return vertex.count, rest


def _expected(name: str) -> tuple[str, ...]:
    """The types that a column of the format may have; none for another column."""
    if name in _PACKED:
        return ("uint", "uint32")
    if name in _BOUNDS:
        return ("float", "float32")
    return ("uchar", "uint8") if name.startswith("f_rest_") else ()


def _read(path: Path, header: PlyHeader, sh_count: int) -> Blocks:
    bounds = _bounds(path, header)
    rest = _sh_blocks(path, header, sh_count)
    start = 0
    for rows in element_blocks(path, header, "vertex", AT_ONCE):
        own = bounds[start // CHUNK : -(-(start + len(rows)) // CHUNK)]
        yield _unpack(rows, own, next(rest))
        start += len(rows)


def _bounds(path: Path, header: PlyHeader) -> Float32[np.ndarray, "chunks 3 2 3"]:
    """Bounds of each chunk: position, log scale and color; least and greatest; x y z."""
    parts = list(element_blocks(path, header, "chunk", AT_ONCE))
    chunks = np.concatenate(parts) if parts else np.zeros(0, [(name, "<f4") for name in _BOUNDS])
    bounds = np.zeros((len(chunks), len(_BOUNDS)), np.float32)
    bounds[:, 15:] = 1  # colors of old files lie between 0 and 1
    for i, name in enumerate(_BOUNDS):
        if name in (chunks.dtype.names or ()):
            bounds[:, i] = chunks[name]
    return bounds.reshape(-1, 3, 2, 3)


def _sh_blocks(path: Path, header: PlyHeader, count: int) -> Iterator[np.ndarray]:
    """The SH bytes of the same rows as the blocks of vertices, channel-major."""
    if count == 0:
        while True:
            yield np.zeros((0, 0), np.uint8)
    names = [f"f_rest_{i}" for i in range(count)]
    for rows in element_blocks(path, header, "sh", AT_ONCE):
        yield np.stack([rows[name] for name in names], axis=1)


def _unpack(rows: np.ndarray, bounds: np.ndarray, rest: UInt8[np.ndarray, "_ _"]) -> SplatTable:
    """Rows that begin with a chunk, and the bounds of their chunks."""
    n = len(rows)
    packed = {name: rows[name].astype(np.uint32) for name in _PACKED}
    low, high = (np.repeat(bounds[:, :, end], CHUNK, axis=0)[:n] for end in (0, 1))

    def between(field: int, shares: np.ndarray) -> np.ndarray:
        return low[:, field] + shares * (high[:, field] - low[:, field])

    color = _shares(packed["packed_color"], ((24, 8), (16, 8), (8, 8), (0, 8)))
    sh = np.zeros((n, 1 + rest.shape[1] // 3, 3), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # damaged rows are found later
        sh[:, 0] = color_to_sh(between(2, color[:, :3]))
    if rest.size:
        sh[:, 1:] = _SH_VALUES[rest[:n]].reshape(n, 3, -1).transpose(0, 2, 1)
    return SplatTable(
        between(0, _shares(packed["packed_position"], _POSITION_BITS)),
        _unpack_quats(packed["packed_rotation"]),
        between(1, _shares(packed["packed_scale"], _POSITION_BITS)),
        logits_of(color[:, 3]),
        sh,
    )


def _shares(
    packed: UInt32[np.ndarray, " n"], places: tuple[tuple[int, int], ...]
) -> Float32[np.ndarray, "n c"]:
    """Whole numbers of some bits each as shares of the greatest."""
    out = np.empty((len(packed), len(places)), np.float32)
    for i, (shift, bits) in enumerate(places):
        most = (1 << bits) - 1
        out[:, i] = ((packed >> np.uint32(shift)) & np.uint32(most)) * np.float32(1 / most)
    return out


def _unpack_quats(packed: UInt32[np.ndarray, " n"]) -> Float32[np.ndarray, "n 4"]:
    """The largest of wxyz is left out: its index is in the first two bits."""
    small = (_shares(packed, ((20, 10), (10, 10), (0, 10))) - np.float32(0.5)) * np.float32(2**0.5)
    return from_smallest_three(small, packed >> np.uint32(30))


_SH_VALUES = (
    (np.arange(256, dtype=np.float32) + np.float32(0.5)) / 256 - np.float32(0.5)
) * SH_RANGE
"""The SH coefficient of each byte: the middle of what the writer rounds down to it."""
_SH_VALUES[[0, 255]] = -SH_RANGE / 2, SH_RANGE / 2  # as PlayCanvas reads them


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write chunks of Gaussians in Morton order; the number of rows. Holds the scene, its SH beyond
    the DC term as bytes."""
    rest = 3 * (header.degree + 1) ** 2 - 3
    beside = SceneHeader(0, {_REST: np.dtype((np.uint8, rest))} if rest else {})
    table = gather(map(_with_bytes, blocks), beside, 0)
    order = morton_order(table.means)
    bounds, packed = _pack(table, order)
    parts = {
        "chunk": (bounds, [(name, "<f4") for name in _BOUNDS]),
        "vertex": (packed, [(name, "<u4") for name in _PACKED]),
    }
    if rest:
        names = [(f"f_rest_{i}", "u1") for i in range(rest)]
        parts["sh"] = (table.extra[_REST][order], names)
    lines = (
        f"element {name} {len(rows)}\n{element_header(np.dtype(row))}"
        for name, (rows, row) in parts.items()
    )
    with path.open("wb") as handle:
        start = f"ply\nformat binary_little_endian 1.0\n{''.join(lines)}end_header\n"
        handle.write(start.encode())
        for rows, row in parts.values():
            np.ascontiguousarray(rows, row[0][1]).tofile(handle)
    return len(table)


def _with_bytes(table: SplatTable) -> SplatTable:
    """The table with its SH beyond the DC term as bytes, channel-major, in the column _REST."""
    rest = table.sh[:, 1:].transpose(0, 2, 1).reshape(len(table), -1)
    with np.errstate(invalid="ignore", over="ignore"):  # damaged rows: told later
        bytes_ = ((rest / SH_RANGE + 0.5) * 256).clip(0, 255).astype(np.uint8)
    return table.replace(sh=table.sh[:, :1], extra={_REST: bytes_} if bytes_.size else {})


def _pack(
    table: SplatTable, order: Int[np.ndarray, " n"]
) -> tuple[Float32[np.ndarray, "chunks 18"], UInt32[np.ndarray, "n 4"]]:
    """The bounds of the chunks of a table in some order, and its packed Gaussians."""
    starts = np.arange(0, len(table), CHUNK)
    bounds, packed = [], np.empty((len(table), 4), "<u4")
    color = np.empty((len(table), 4), np.float32)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # damaged rows: told later
        color[:, 3] = table.opacities[order]
        for column, values in ((0, table.means), (2, table.log_scales), (3, table.colors)):
            values = values[order]
            values = values.clip(-SCALE_LIMIT, SCALE_LIMIT) if column == 2 else values
            low, high = (end.reduceat(values, starts, axis=0) for end in (np.minimum, np.maximum))
            bounds += [low, high]
            size = np.where(high > low, high - low, 1)
            shares = values - np.repeat(low, CHUNK, axis=0)[: len(table)]
            shares /= np.repeat(size, CHUNK, axis=0)[: len(table)]
            if column == 3:
                color[:, :3] = shares
            else:
                packed[:, column] = _bits(shares, _POSITION_BITS)
        packed[:, 1] = _pack_quats(table.quats[order])
        packed[:, 3] = bytes_of(color)[:, ::-1].copy().view("<u4")[:, 0]
    return np.concatenate(bounds, axis=1), packed


def _bits(
    shares: Float32[np.ndarray, "n c"], places: tuple[tuple[int, int], ...]
) -> UInt32[np.ndarray, " n"]:
    """Shares in [0, 1] as whole numbers of some bits each, beside each other."""
    out = np.zeros(len(shares), np.uint32)
    for i, (shift, bits) in enumerate(places):
        whole = (shares[:, i].clip(0, 1) * ((1 << bits) - 1) + 0.5).astype(np.uint32)
        out |= whole << np.uint32(shift)
    return out


def _pack_quats(quats: Float32[np.ndarray, "n 4"]) -> UInt32[np.ndarray, " n"]:
    """The index of the largest of wxyz, and the other three in 10 bits each."""
    others, largest = smallest_three(quats)
    small = others * np.float32(0.5**0.5) + np.float32(0.5)
    return _bits(small, ((20, 10), (10, 10), (0, 10))) | (largest.astype(np.uint32) << 30)
