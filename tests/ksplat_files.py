"""Files of mkkellogg's .ksplat, written here by its published layout."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from splat_tables import random_table

from gsedit.scene.table import SplatTable
from rasterizer.numerics import SH_DC


def header(level: int, sections: int, count: int, version: tuple[int, int] = (0, 1)) -> bytes:
    start = struct.pack("<BBxxIIIIH", *version, sections, sections, count, count, level)
    return start.ljust(36, b"\0") + struct.pack("<ff", -1.5, 1.5).ljust(4096 - 36, b"\0")


def section(
    level: int, table: SplatTable, capacity: int = 4, block: float = 8.0
) -> tuple[bytes, bytes]:
    """Its header and its data: full buckets of `capacity` rows, then two that are not full.

    A bucket's center is its first row's, so that its rows lie within block / 2 of it.
    """
    n, degree = len(table), table.degree
    full = max((n - 2) // capacity, 0) if level else 0
    sizes = [n - full * capacity - 1, 1] if level else []
    starts = [*range(0, full * capacity, capacity), full * capacity, n - 1] if level else []
    centers = table.means[starts]
    head = struct.pack("<4IfH2xIIIIH", n, n + 3, capacity, len(starts), block, 12, 32767, 0, full,
                       len(sizes), degree)  # fmt: skip
    body = np.uint32(sizes).tobytes() + centers.tobytes()
    bucket = np.minimum(np.arange(n) // capacity, full) + (np.arange(n) == n - 1) if level else None
    for i in range(n):
        if bucket is None:
            body += table.means[i].tobytes()
        else:
            offset = (table.means[i] - centers[bucket[i]]) / (block / 2 / 32767)
            body += np.rint(offset + 32767).astype("<u2").tobytes()
        number = "<f2" if level else "<f4"
        body += table.scales[i].astype(number).tobytes() + table.quats[i].astype(number).tobytes()
        rgba = np.append(table.sh[i, 0] * SH_DC + 0.5, table.opacities[i]) * 255
        body += np.rint(rgba).clip(0, 255).astype("u1").tobytes()
        for band in range(1, degree + 1):  # red, green, blue of a band
            rest = table.sh[i, band**2 : (band + 1) ** 2].T
            if level == 2:
                body += np.rint((rest + 1.5) / 3 * 255).astype("u1").tobytes()
            else:
                body += rest.astype(number).tobytes()
    row = {0: 44, 1: 24, 2: 24}[level] + {0: 4, 1: 2, 2: 1}[level] * 3 * ((degree + 1) ** 2 - 1)
    return head.ljust(1024, b"\0"), body + bytes(3 * row)


def ksplat(path: Path, level: int, *tables: SplatTable) -> Path:
    parts = [section(level, table) for table in tables]
    heads, bodies = (b"".join(each) for each in zip(*parts))
    path.write_bytes(header(level, len(tables), sum(map(len, tables))) + heads + bodies)
    return path


def near_grey(n: int, degree: int, seed: int = 0) -> SplatTable:
    """Colors in [0, 1], which is what the format holds, in one place of space."""
    table = random_table(n, degree, seed)
    sh = np.concatenate((table.sh[:, :1].clip(-1.7, 1.7), table.sh[:, 1:]), 1)
    return table.replace(sh=sh, means=table.means.clip(-1.5, 1.5))
