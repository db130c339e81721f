"""Survey of a scene: which Gaussians are not part of the captured scene, and why (see `defects`).

`n` Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, UInt8

from gsedit.errors import UsageError
from gsedit.formats.validity import invalid_rows
from gsedit.scene.neighbors import NEIGHBORS, covers, nearest
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SplatTable
from gsedit.toolkit.defects import (
    DEFECTS,
    DUPLICATE,
    FLOATER,
    GIANT,
    INVISIBLE,
    NEEDLE,
    Rows,
    fingerprints,
    invisible,
    repeated,
)

KEPT, INVALID_ROW = 0, 1
"""Reasons that are no defect of DEFECTS; these have the numbers from 2 on, in its order."""
REASONS = ("kept", "invalid", *(defect.name for defect in DEFECTS))
"""The name of every number in an array of reasons."""
FEWEST = 64
"""Fewest Gaussians that tell what is usual: a smaller scene has no giants, floaters or needles."""
TINY = float(np.finfo(np.float32).tiny)
CORE_SHARE, OUTLIERS = 0.99, 20.0
"""The scene's radius holds this share of the centers; it is at most so many times the median
distance, which outliers do not move."""
END = 2.0
"""Standard deviations from its center at which a splat seems to end in a picture: 14 % of its
opacity are left."""
LONG, STREAK = 4.0, 0.08
"""A needle's 2 standard deviations are longer than so many distances to the 8th neighbor, and
than this share of the scene's radius."""
OPEN = 0.3
"""The end of a needle is in the open if others cover it with less than this share of the needle's
own opacity."""
PEELS = 8
"""Rounds, at most: without the outermost streaks of a bundle, the next ones end in the open."""
ALIKE = 1.5
"""A needle holds the end of another one that is at most this many times shorter than itself: the
pieces of a string hold each other, a bundle of streaks of all lengths does not."""


@dataclass(frozen=True)
class Limits:
    """The thresholds of the laws in DEFECTS, in their units; None: the law is not asked."""

    invisible: float | None = INVISIBLE.threshold
    giant: float | None = GIANT.threshold
    floater: float | None = FLOATER.threshold
    needle: float | None = NEEDLE.threshold
    duplicates: bool = True

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not value >= 0:
                raise UsageError(f"the limit {field.name} is {value}: give a number above 0")


USUAL = Limits()


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Properties of each Gaussian's neighbors that the criteria use."""

    distance: Float[np.ndarray, " n"]
    """To the 8th neighbor, world units."""
    usual: Float[np.ndarray, " n"]
    """The median of the same of its 8 neighbors."""
    radius: float
    """Radius of the scene about its middle, world units."""


def surroundings(table: SplatTable) -> Surroundings:
    """The neighbors of each Gaussian, and the size of the scene."""
    distance, rows = nearest(table.means, NEIGHBORS)
    usual = np.median(distance[rows], axis=1) if rows.shape[1] else distance
    return Surroundings(distance, usual, scene_radius(table.means))


def scene_radius(means: Float[np.ndarray, "n 3"]) -> float:
    """The distance from the median position that holds most centers; outliers do not move it."""
    offset = means.astype(np.float64) - np.median(means, axis=0)
    median, most = np.quantile(np.linalg.norm(offset, axis=1), (0.5, CORE_SHARE)).tolist()
    return min(most, OUTLIERS * median)


def find_defects(table: SplatTable, limits: Limits = USUAL) -> UInt8[np.ndarray, " n"]:
    """Why each Gaussian is no part of the scene: an index into REASONS, 0 for those that are.

    Of several reasons the first in the order of REASONS. Needs no torch.
    """
    reasons = np.full(len(table), KEPT, np.uint8)
    reasons[invalid_rows(table)] = INVALID_ROW
    if limits.duplicates:
        _mark(reasons, DUPLICATE.name, repeated(fingerprints(table)))
    if limits.invisible is not None:
        _mark(reasons, INVISIBLE.name, invisible(table, limits.invisible))
    left = np.flatnonzero(reasons == KEPT)
    if limits.giant is not None and len(left) > FEWEST:
        found = giants(table[left].replace(extra={}), limits.giant)
        _mark(reasons, GIANT.name, np.isin(np.arange(len(table)), left[found]))
    left = np.flatnonzero(reasons == KEPT)
    if len(left) <= FEWEST or limits.floater is limits.needle is None:
        return reasons
    some = table[left].replace(sh=table.sh[left, :1], extra={})
    about, found = surroundings(some), np.full(len(left), KEPT, np.uint8)
    if limits.floater is not None:
        _mark(found, FLOATER.name, floaters(some, about, limits.floater))
    if limits.needle is not None:
        _mark(found, NEEDLE.name, needles(some, about, limits.needle))
    reasons[left] = found
    return reasons


def giants(table: SplatTable, times: float) -> Rows:
    """The Gaussians larger than the scene in whose body its middle lies: not those of a sky."""
    large = np.flatnonzero(table.scales.max(1) > times * scene_radius(table.means))
    found = np.zeros(len(table), bool)
    if len(large):
        offset = np.median(table.means, axis=0) - table.means[large]
        local = np.einsum("mi,mij->mj", offset, rotations(table.quats[large]))
        apart = np.linalg.norm(local / np.maximum(table.scales[large], TINY), axis=1)
        found[large] = apart < END
    return found


def floaters(table: SplatTable, about: Surroundings, times: float) -> Rows:
    """The Gaussians that are far from all others, for what is usual there and for their size."""
    alone = (about.distance > times * about.usual) | (about.distance > about.radius)
    return alone & (about.distance > END * table.scales.max(1))


def needles(table: SplatTable, about: Surroundings, ratio: float) -> Rows:
    """The thin, long Gaussians of which one end touches nothing that stays."""
    scales = np.sort(table.scales, 1)
    length = END * scales[:, 2]
    thin = scales[:, 2] > ratio * scales[:, 1]
    thin &= (length > LONG * about.usual) & (length > STREAK * about.radius)
    rows, gone = np.flatnonzero(thin), np.zeros(len(table), bool)
    longest = table.log_scales[rows].argmax(1)[:, None, None]
    axes = np.take_along_axis(rotations(table.quats[rows]), longest, 2)[:, :, 0]
    ends = table.means[rows] + length[rows, None] * np.stack((axes, -axes))
    over = covers(table, ends.reshape(-1, 3))
    own = rows[over.point % max(len(rows), 1)]
    holds = ~thin[over.row] | (scales[over.row, 2] <= ALIKE * scales[own, 2])
    holds &= over.row != own
    point, row, alpha = over.point[holds], over.row[holds], over.alpha[holds]
    for _ in range(PEELS):
        stays = ~gone[row]
        covered = np.bincount(point[stays], alpha[stays], 2 * len(rows)).reshape(2, -1).min(0)
        gone[rows] |= covered < OPEN * table.opacities[rows]
    return gone


def _mark(reasons: UInt8[np.ndarray, " n"], name: str, rows: Rows) -> None:
    """Give the rows that have no reason yet this one."""
    reasons[rows & (reasons == KEPT)] = REASONS.index(name)
