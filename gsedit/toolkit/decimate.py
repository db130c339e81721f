"""Rows in another order, and fewer Gaussians with the same look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from gsedit.errors import InputError, UsageError
from gsedit.formats.validity import describe_invalid, invalid_rows
from gsedit.scene.merging.pairs import groups, mean_area, represent
from gsedit.scene.morton import morton_order
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit.operation import Say, Whole

if TYPE_CHECKING:
    from rasterizer.camera import Camera


@dataclass(frozen=True)
class Order(Whole):
    """Sort the rows along Morton's curve, or by importance: opacity times projected area."""

    sorts: ClassVar[bool] = True
    by: str = "morton"

    def __post_init__(self) -> None:
        if self.by not in ("morton", "importance"):
            raise UsageError(f"order by {self.by}: morton and importance are possible")

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        if self.by == "morton":
            return table[morton_order(table.means)]
        return table[np.argsort(-importance(table), kind="stable")]


def importance(table: SplatTable) -> Float[np.ndarray, " n"]:
    """Opacity times mean projected area."""
    return table.opacities.astype(np.float64) * mean_area(table.scales)


SIZE, VIEWS = 256, 8
"""Longer side, pixels, and number of the pictures that tell what changed."""
METHODS = ("merge", "importance", "random")


@dataclass(frozen=True, eq=False)
class Decimate(Whole):
    """Leave a number of Gaussians, or a share of them.

    `merge` joins near ones (gsedit.scene.merging.pairs); `importance` keeps those of most opacity
    times projected area; `random` keeps any. `merge` refuses rows with NaN or Inf.
    """

    removes: ClassVar[bool] = True
    count: int | None = None
    share: float | None = None
    method: str = "merge"
    measure: bool = False
    """Whether to tell the change of the pictures, in dB."""
    views: Sequence[Camera] | None = None
    """To measure from; an orbit if None."""

    def __post_init__(self) -> None:
        if (self.count is None) == (self.share is None):
            raise UsageError("decimate to a number or to a share")
        if self.share is not None and not 0 < self.share <= 1:
            raise UsageError(f"decimate to {100 * self.share:g} %: above 0, at most 100 %")
        if self.count is not None and self.count < 1:
            raise UsageError(f"decimate to {self.count}: keep at least 1")
        if self.method not in METHODS:
            raise UsageError(f"decimate by {self.method}: {', '.join(METHODS)} are possible")

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        count = (self.count or 0) if self.share is None else share_of(len(table), self.share)
        if count >= len(table):
            return table
        after = fewer(table, count, self.method)
        if self.measure:
            where = "an orbit" if self.views is None else "the given cameras"
            number = f"{picture_change(table, after, self.views):.2f}"
            say(f"pictures from {where} keep {number} dB (PSNR against those before)")
        return after


def share_of(rows: int, share: float) -> int:
    """A share of some rows, rounded up, and at least 1."""
    return max(1, ceil(round(rows * share, 6)))  # 55 % of 100 are 55, not 55.00000000000001


def fewer(table: SplatTable, count: int, method: str) -> SplatTable:
    """The table with `count` rows. Raises InputError where invalid ones would be joined."""
    if method == "random":
        rows = np.random.default_rng(0).permutation(len(table))[:count]
        return table[np.sort(rows)]
    if method == "importance":
        return table[np.sort(np.argsort(-importance(table), kind="stable")[:count])]
    bad = invalid_rows(table)
    if bad.any():
        row = int(bad.argmax())
        raise InputError(
            f"{describe_invalid(table, row, row)}; {bad.sum():,} of {len(table):,} rows are "
            "invalid and cannot be joined: put clean --repair before it, or add --drop-invalid"
        )
    return represent(table, groups(table, count))


def picture_change(
    before: SplatTable, after: SplatTable, cameras: Sequence[Camera] | None = None
) -> float:
    """PSNR, dB, of the pictures of `after` against those of `before`, over black.

    Of up to VIEWS of `cameras`, evenly chosen; of an orbit around `before` if None.
    """
    from gsedit.measures.decibels import psnr_from_rmse
    from gsedit.measures.formulas import pooled_rmse, squared_error
    from gsedit.scene.picture import render_picture
    from gsedit.views.orbit import orbit

    scene, other = gaussians_of(before), gaussians_of(after)
    cameras = orbit(scene, VIEWS, SIZE) if cameras is None else cameras
    chosen = [each.fitted(SIZE) for each in cameras[:: -(-len(cameras) // VIEWS)]]
    pairs = ((render_picture(other, each), render_picture(scene, each)) for each in chosen)
    rmse = pooled_rmse(squared_error(*pair) for pair in pairs)
    return psnr_from_rmse(rmse or 0.0)
