"""mkkellogg's .ksplat: compression levels 0, 1 and 2, SH to degree 2. Read only: its author points
to newer formats.

A header of 4,096 bytes and one of 1,024 for each section, then the sections: the centers of buckets
and rows of float32 (level 0), of 16-bit places around those centers and float16 (1), the same with
SH of 8 bits (2). Reading holds one block.
Source: github.com/mkkellogg/GaussianSplats3D, src/loaders/SplatBuffer.js.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.formats.quantised import log_scales_of, logits_of
from gsedit.formats.streams import AT_ONCE, Blocks, ReadOptions, SceneHeader, SceneSource
from gsedit.scene.table import SplatTable
from rasterizer.numerics import color_to_sh

_HEADER, _SECTION = 4096, 1024
_BUCKET = 12
"""Bytes of a bucket: its center, float32."""
_NUMBERS = ("<f4", "<f2", "<f2")
"""Number types of scales, rotations and SH by compression level; level 2 has SH of its own."""
_SH = ("<f4", "<f2", "u1")
_SH_RANGE = (-1.5, 1.5)
"""Range of SH in level 2, where the header leaves it at zero."""
_MIDDLE = 32767
"""Middle of a 16-bit coordinate, where the section leaves it at zero."""
_AGAIN = "it is cut off or damaged, copy or export it again"


@dataclass(frozen=True, eq=False)
class _Section:
    """Rows of one layout, one after another."""

    level: int
    degree: int
    count: int
    buckets_at: int
    partial: int
    """Buckets that are not full; their sizes come first."""
    full: int
    capacity: int
    """Rows of a full bucket."""
    buckets: int
    rows_at: int
    step: float
    """Step of a coordinate, world units."""
    middle: int
    sh_range: tuple[float, float]

    @property
    def row(self) -> np.dtype:
        return _row(self.level, self.degree)


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .ksplat. Raises InputError for one whose headers cannot be right."""
    sections = list(_sections(path))
    level = sections[0].level if sections else 0
    return SceneSource(
        path,
        f".ksplat, compression level {level}",
        SceneHeader(max((s.degree for s in sections), default=0)),
        sum(s.count for s in sections),
        partial(_blocks, path, sections),
    )


def _row(level: int, degree: int) -> np.dtype:
    """A row as it lies in the file."""
    number = _NUMBERS[level]
    fields = [("means", "<f4" if level == 0 else "<u2", 3), ("scales", number, 3)]
    fields += [("quats", number, 4), ("rgba", "u1", 4)]
    fields += [("sh", _SH[level], 3 * ((degree + 1) ** 2 - 1))] if degree else []
    return np.dtype(fields)


def _sections(path: Path) -> Iterator[_Section]:
    """The sections that hold rows, checked against the size of the file."""
    size = path.stat().st_size
    with path.open("rb") as handle:
        header = handle.read(_HEADER)
        if len(header) < _HEADER:
            raise InputError(f"{path} is no .ksplat, it is shorter than its header: {_AGAIN}")
        major, minor = header[0], header[1]
        number, level = struct.unpack_from("<I12xH", header, 4)
        if major != 0 or minor < 1 or level > 2:
            raise InputError(
                f"{path} is .ksplat {major}.{minor} of compression level {level}: gsedit reads "
                "0.1 of levels 0 to 2, export it again"
            )
        at = _HEADER + number * _SECTION
        if at > size:
            raise InputError(f"{path} announces {number} sections, more than it holds: {_AGAIN}")
        ends = struct.unpack_from("<2f", header, 36)
        low, high = (end or usual for end, usual in zip(ends, _SH_RANGE))
        if not (isfinite(low) and isfinite(high)):
            raise InputError(f"{path}: its range of SH is not finite: {_AGAIN}")
        for index in range(number):
            section, at = _section(path, index, handle.read(_SECTION), at, level, (low, high))
            if at > size:
                raise InputError(
                    f"{path}: section {index} promises {at - size} bytes more than there are: "
                    f"{_AGAIN}"
                )
            if section.count:
                yield section


def _section(
    path: Path, index: int, raw: bytes, at: int, level: int, sh_range: tuple[float, float]
) -> tuple[_Section, int]:
    """One section that begins at byte `at`, and where the next one does."""
    count, room, capacity, buckets = struct.unpack_from("<4I", raw)
    block, stored = struct.unpack_from("<fH", raw, 16)
    middle, _, full, part, degree = struct.unpack_from("<4IH", raw, 24)
    if degree > 2 or count > room:
        raise InputError(
            f"{path}: section {index} has SH degree {degree} and {count} of {room} rows: {_AGAIN}"
        )
    spread = level > 0 and count > 0
    if spread and (
        stored != _BUCKET or full + part > buckets or not isfinite(block) or not capacity
    ):
        raise InputError(f"{path}: section {index} has no sensible buckets: {_AGAIN}")
    rows_at = at + 4 * part + stored * buckets
    middle = middle or _MIDDLE
    section = _Section(
        level, degree, count, at, part, full, capacity, buckets, rows_at,
        block / 2 / middle, middle, sh_range,
    )  # fmt: skip
    return section, rows_at + section.row.itemsize * room


def _blocks(path: Path, sections: list[_Section]) -> Blocks:
    degree = max((s.degree for s in sections), default=0)
    with path.open("rb") as handle:
        for section in sections:
            handle.seek(section.buckets_at)
            sizes = np.fromfile(handle, "<u4", section.partial)
            centers = np.fromfile(handle, "<f4", 3 * section.buckets).reshape(-1, 3)
            if section.level and section.full * section.capacity + sizes.sum() < section.count:
                raise InputError(f"{path}: its buckets hold fewer rows than it has: {_AGAIN}")
            ends = np.cumsum(sizes, dtype=np.int64) + section.full * section.capacity
            handle.seek(section.rows_at)
            for start in range(0, section.count, AT_ONCE):
                number = min(AT_ONCE, section.count - start)
                rows = np.fromfile(handle, section.row, number)
                if len(rows) < number:
                    raise InputError(f"{path} became shorter while it was read: copy it again")
                index = np.arange(start, start + number)
                bucket = index // max(section.capacity, 1)
                beyond = np.searchsorted(ends, index, side="right") + section.full
                bucket = np.where(bucket < section.full, bucket, beyond)
                origins = centers[bucket] if section.level else None
                yield _unpacked(rows, section, origins, (degree + 1) ** 2)


def _unpacked(
    rows: np.ndarray, section: _Section, origins: np.ndarray | None, k: int
) -> SplatTable:
    means = rows["means"].astype(np.float32)
    if origins is not None:
        with np.errstate(invalid="ignore", over="ignore"):  # damaged rows are found later
            means = (means - section.middle) * np.float32(section.step) + origins
    rgba = rows["rgba"].astype(np.float32) / 255
    log_scales = log_scales_of(rows["scales"].astype(np.float32))
    sh = np.zeros((len(rows), k, 3), np.float32)
    sh[:, 0] = color_to_sh(rgba[:, :3])
    if section.degree:
        rest = rows["sh"].astype(np.float32)
        if section.level == 2:
            low, high = section.sh_range
            rest = rest / 255 * np.float32(high - low) + np.float32(low)
        for degree in range(1, section.degree + 1):
            sh[:, degree**2 : (degree + 1) ** 2] = _band(rest, degree)
    quats = rows["quats"].astype(np.float32)
    return SplatTable(means, quats, log_scales, logits_of(rgba[:, 3]), sh)


def _band(rest: Float32[np.ndarray, "n c"], degree: int) -> Float32[np.ndarray, "n m 3"]:
    """The coefficients of one degree: all of red, then green, then blue."""
    ours = rest[:, 3 * (degree**2 - 1) : 3 * ((degree + 1) ** 2 - 1)]
    return ours.reshape(len(rest), 3, -1).transpose(0, 2, 1)
