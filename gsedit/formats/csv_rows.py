"""A scene as text: a line a Gaussian, the columns of INRIA's .ply, for tables and scripts."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from gsedit.formats.ply.inria import SPLAT, beside, columns, rows_of
from gsedit.formats.streams import Blocks, SceneHeader, WriteOptions, in_blocks

LINES = 1024
"""Rows that become text at a time."""


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write a line of column names and a line a Gaussian, nine digits a number: float32 exactly.

    The number of rows.
    """
    names = columns((header.degree + 1) ** 2)
    extra = beside(path, header)
    row = np.dtype([(SPLAT, "<f4", len(names)), *extra.items()])
    forms = ["%.9g"] * len(names) + [_form(kind) for kind in extra.values()]
    line = ",".join(forms) + "\n"
    count = 0
    with path.open("w", encoding="utf-8", newline="") as handle:
        csv.writer(handle, lineterminator="\n").writerow((*names, *extra))
        for block in blocks:
            for part in in_blocks(block, LINES):
                rows = rows_of(part, row)
                handle.write(line * len(part) % _values(rows, tuple(extra)))
                count += len(part)
    return count


def _form(kind: np.dtype) -> str:
    return {"f": "%.17g" if kind.itemsize > 4 else "%.9g"}.get(kind.kind, "%s")


def _values(rows: np.ndarray, extra: tuple[str, ...]) -> tuple[object, ...]:
    """All numbers, row by row."""
    if not extra:
        return tuple(rows[SPLAT].ravel().tolist())
    more_columns = [rows[name].tolist() for name in extra]
    pairs = zip(rows[SPLAT].tolist(), zip(*more_columns))
    return tuple(value for splat, more in pairs for value in (*splat, *more))
