"""Rows that no renderer can draw: found, described, refused or left out."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, log
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import InputError
from gsedit.formats.limits import MAX_POSITION, MAX_SH
from gsedit.formats.ply.inria import field_columns
from gsedit.formats.streams import Blocks
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SPLAT_FIELDS, SplatTable

MAX_NORM = 1e9
"""Longest quaternion: its length squared has room in float32."""
MAX_LOG_SCALE = log(MAX_POSITION)
"""Log scale of a Gaussian as large as the largest coordinate: its area squared fits float32."""


def wrong_values(table: SplatTable) -> dict[str, Any]:
    """By field: a mask of its values that are NaN, Inf, or beyond any scene."""
    most = {"means": MAX_POSITION, "sh": MAX_SH}
    found = {}
    for name in SPLAT_FIELDS:
        values = getattr(table, name)
        found[name] = ~(np.abs(values) <= most[name]) if name in most else ~np.isfinite(values)
    with np.errstate(invalid="ignore"):
        found["log_scales"] |= table.log_scales > MAX_LOG_SCALE
    return found


def without_turn(table: SplatTable) -> Bool[np.ndarray, " n"]:
    """Rows whose quaternion has a length of 0 or beyond MAX_NORM; NaN is in `wrong_values`."""
    with np.errstate(invalid="ignore", over="ignore"):
        norms = np.einsum("ij,ij->i", table.quats, table.quats)
        return (norms < 1e-24) | (norms > MAX_NORM**2)  # torch's normalize gives up there


def invalid_rows(table: SplatTable) -> Bool[np.ndarray, " n"]:
    """Rows with NaN or Inf, a quaternion of length 0, or a position, a scale or light beyond any
    scene."""
    bad = without_turn(table)
    for wrong in wrong_values(table).values():
        if wrong.any():  # rarely; and to reduce each row takes six times as long
            bad |= wrong.reshape(len(table), -1).any(1)
    return bad


def describe_invalid(table: SplatTable, row: int, number: int, of: str = "") -> str:
    """Describe the first problem of a row; `number` is its row in the file (or in the scene named
    `of`)."""
    fields, one = field_columns(table.sh.shape[1]), table[row : row + 1]
    found = [
        (name, value)
        for field, wrong in wrong_values(one).items()
        for name, value in zip(fields[field][wrong[0]], getattr(one, field)[wrong].tolist())
    ]
    name, value = min(found, key=lambda each: isfinite(each[1]), default=("", 0.0))
    place = f"column {name} is {value:g}" + ", beyond any scene" * isfinite(value)
    if not found:
        place = f"its quaternion rot_0..rot_3 is zero, or longer than {MAX_NORM:g}"
    return f"row {number} (from 0){f' of {of}' * bool(of)}: {place}"


class Guard:
    """Passes blocks on, and counts the invalid rows: they are left out, or refused at the end."""

    def __init__(self, *, drop: bool, of: str = "") -> None:
        self.drop, self.of = drop, of
        self.rows = self.invalid = 0
        self.first = ""
        """The first invalid row, described."""

    def __call__(self, blocks: Blocks) -> Blocks:
        for block in blocks:
            bad = invalid_rows(block)
            if bad.any():
                at = int(bad.argmax())
                self.first = self.first or describe_invalid(block, at, self.rows + at, self.of)
            self.rows += len(block)
            self.invalid += int(bad.sum())
            yield block[~bad] if self.drop and bad.any() else block

    def check(self, path: Path, fail: Callable[[str], Exception] = InputError) -> None:
        """Raise `fail` if rows were invalid and not left out, or nothing else is there."""
        if self.invalid and not self.drop:
            raise fail(
                f"{path}: {self.first}; {self.invalid} of {self.rows} rows are invalid: "
                "--drop-invalid leaves them out, gsedit clean --repair mends what can be mended"
            )
        if self.invalid and self.invalid == self.rows:
            raise fail(f"{path}: all {self.rows} rows are invalid: export it again")
