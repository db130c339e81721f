"""Rows that no renderer can draw: found, described, refused or left out."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path

import numpy as np

from gsedit.errors import InputError
from gsedit.files.inria import field_columns
from gsedit.files.shapes import Bool
from gsedit.files.streams import Blocks
from gsedit.files.table import SPLAT_FIELDS, SplatTable

MIN_NORM = 1e-12
"""A shorter quaternion has no direction: torch's normalize gives up here too."""
MAX_LOG_SCALE = 40.0
"""e^40 squared still has room in float32; a scene never does."""


def invalid_rows(table: SplatTable) -> Bool[np.ndarray, " n"]:
    """Rows with NaN or Inf, a quaternion of length 0, or a scale beyond any scene."""
    with np.errstate(invalid="ignore", over="ignore"):
        bad = np.einsum("ij,ij->i", table.quats, table.quats) < MIN_NORM**2
        too_large = table.log_scales > MAX_LOG_SCALE
    fields = [~np.isfinite(getattr(table, name)) for name in SPLAT_FIELDS]
    for wrong in (too_large, *fields):
        if wrong.any():  # rarely; and to reduce each row takes six times as long
            bad |= wrong.reshape(len(table), -1).any(1)
    return bad


def describe_invalid(table: SplatTable, row: int, number: int, of: str = "") -> str:
    """What is wrong with a row of the table, which is row `number` of the file, or of `of`."""
    numbers = (
        (name, value)
        for field, names in field_columns(table.sh.shape[1]).items()
        for name, value in zip(names.ravel(), np.ravel(getattr(table, field)[row]).tolist())
    )
    largest = float(table.log_scales[row].max())
    place = next(
        (f"column {name} is {value}" for name, value in numbers if not isfinite(value)), ""
    )
    if not place and largest > MAX_LOG_SCALE:
        place = f"a scale is exp({largest:g}), beyond any scene"
    place = place or "its quaternion rot_0..rot_3 is zero"
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
                "--drop-invalid leaves them out, gsedit repair mends what can be mended"
            )
        if self.invalid and self.invalid == self.rows:
            raise fail(f"{path}: all {self.rows} rows are invalid: export it again")
