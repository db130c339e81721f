"""Rows in another order, and fewer Gaussians with the same look: some left out, or joined.

A group of Gaussians becomes the one with the moments of their mixture, weighted by mass: opacity
times mean projected area. Pairs of neighbors are joined in rounds, cheapest first. The cost is
Runnalls' bound on the change of the mixture (2007, "Kullback-Leibler approach to Gaussian mixture
reduction", eq. 16) and the spread of the colors. numpy and scipy, float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float, Float64, Int

from gsedit.errors import InputError, UsageError
from gsedit.formats.validity import describe_invalid, invalid_rows
from gsedit.scene.neighbors import NEIGHBORS, k_nearest, morton_order
from gsedit.scene.quaternions import principal_axes, rotations
from gsedit.scene.table import SplatTable, concatenate_tables, gaussians_of
from gsedit.toolkit.operation import Say, Whole

if TYPE_CHECKING:
    from rasterizer.camera import Camera

COLOR_WEIGHT = 4.0
"""Cost of a unit of squared color difference, in units of half a log-determinant."""
LEAST_THICKNESS = 0.1
"""Thickness, as a share of the longest axis, that every Gaussian has at least in the cost: one that
no pixel shows must not keep two discs of a surface apart."""
JITTER = 1e-6
"""Random shift for the search, as a share of a Gaussian's size: Gaussians at one place would all
have the same few neighbors, and be joined a few at a time."""
PAIRS_AT_ONCE = 1 << 18
"""Pairs whose costs are computed together: bounds the memory."""
MAX_OPACITY = 0.999
"""Highest opacity of a joined Gaussian: overlapping opaque ones have more mass than one Gaussian
of their extent can have."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Mass, mean, covariance and color of groups of Gaussians; SH and opacities are left out."""

    mass: Float64[np.ndarray, " n"]
    mean: Float64[np.ndarray, "n 3"]
    covariance: Float64[np.ndarray, "n 3 3"]
    color: Float64[np.ndarray, "n 3"]

    def __len__(self) -> int:
        return len(self.mass)

    def __getitem__(self, rows: np.ndarray) -> Moments:
        return Moments(self.mass[rows], self.mean[rows], self.covariance[rows], self.color[rows])


def moments_of(table: SplatTable) -> Moments:
    """Moments of the single Gaussians of a table."""
    scales = table.scales.astype(np.float64)
    axes = rotations(table.quats.astype(np.float64)) * scales[:, None]
    mass = table.opacities.astype(np.float64) * mean_area(scales)
    return Moments(
        np.maximum(mass, np.finfo(np.float64).tiny),
        table.means.astype(np.float64),
        axes @ axes.transpose(0, 2, 1),
        np.clip(table.colors.astype(np.float64), 0, 1),
    )


def join(a: Moments, b: Moments) -> Moments:
    """The moments of each pair's mixture."""
    mass = a.mass + b.mass
    share = (b.mass / mass)[:, None]
    apart = b.mean - a.mean
    within = a.covariance + share[..., None] * (b.covariance - a.covariance)
    between = (share * (1 - share) * apart)[:, :, None] * apart[:, None]
    return Moments(
        mass, a.mean + share * apart, within + between, a.color + share * (b.color - a.color)
    )


def groups(table: SplatTable, count: int) -> Int[np.ndarray, " n"]:
    """The group of every row, 0 to at least count - 1; `count` groups unless rows are too few."""
    now = moments_of(table)
    label = np.arange(len(table))
    shift = JITTER * np.random.default_rng(0).standard_normal(now.mean.shape)
    while len(now) > count:
        neighbors = min(NEIGHBORS + 1, len(now))
        places = now.mean + shift * np.sqrt(np.trace(now.covariance, axis1=1, axis2=2))[:, None]
        near = k_nearest(places, places, neighbors)[1]
        first, second = pairs(now, near, len(now) - count)
        keep = np.ones(len(now), bool)
        keep[second] = False
        target = np.cumsum(keep) - 1
        target[second] = target[first]
        joined = join(now[first], now[second])
        for name in ("mass", "mean", "covariance", "color"):
            getattr(now, name)[first] = getattr(joined, name)
        now, label, shift = now[keep], target[label], shift[keep]
    return label


def pairs(
    now: Moments, near: Int[np.ndarray, "n m"], most: int
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """The cheapest disjoint pairs, at most `most`, each the best of both its members."""
    volume = log_determinant(now.covariance)
    a = np.repeat(np.arange(len(now)), near.shape[1])
    b = near.ravel()
    key = np.unique(np.minimum(a, b) * len(now) + np.maximum(a, b))  # each pair once
    a, b = key // len(now), key % len(now)
    a, b = a[a != b], b[a != b]
    cost = np.concatenate(
        [
            cost_of_joining(now, volume, a[i : i + PAIRS_AT_ONCE], b[i : i + PAIRS_AT_ONCE])
            for i in range(0, len(a), PAIRS_AT_ONCE)
        ]
    )
    best = np.full(len(now), np.inf)
    np.minimum.at(best, a, cost)
    np.minimum.at(best, b, cost)
    chosen = np.flatnonzero((cost == best[a]) & (cost == best[b]))
    chosen = chosen[np.argsort(cost[chosen], kind="stable")]
    chosen = disjoint(a, b, chosen)[:most]
    return a[chosen], b[chosen]


def disjoint(
    a: Int[np.ndarray, " e"], b: Int[np.ndarray, " e"], chosen: Int[np.ndarray, " c"]
) -> Int[np.ndarray, " d"]:
    """The chosen pairs, in order, that are the first of both their members."""
    place = np.arange(len(chosen))
    first = np.full(int(max(a.max(), b.max())) + 1, len(chosen))
    np.minimum.at(first, a[chosen], place)
    np.minimum.at(first, b[chosen], place)
    return chosen[(first[a[chosen]] == place) & (first[b[chosen]] == place)]


def cost_of_joining(
    now: Moments,
    volume: Float64[np.ndarray, " n"],
    a: Int[np.ndarray, " e"],
    b: Int[np.ndarray, " e"],
) -> Float64[np.ndarray, " e"]:
    """Cost of joining each pair: the bound on the change of the mixture, times its mass."""
    i, j = now[a], now[b]
    both = join(i, j)
    growth = both.mass * log_determinant(both.covariance)
    growth -= i.mass * volume[a] + j.mass * volume[b]
    spread = i.mass * j.mass / both.mass * np.square(i.color - j.color).sum(1)
    return 0.5 * growth + COLOR_WEIGHT * spread


def log_determinant(covariance: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, " n"]:
    """Log-determinants of covariances that are thickened to LEAST_THICKNESS."""
    trace = covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]
    floor = LEAST_THICKNESS**2 * trace + np.finfo(np.float64).tiny
    a, b, c = (covariance[:, i, i] + floor for i in range(3))
    d, e, f = covariance[:, 0, 1], covariance[:, 0, 2], covariance[:, 1, 2]
    determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    return np.log(np.maximum(determinant, np.finfo(np.float64).tiny))


def represent(table: SplatTable, label: Int[np.ndarray, " n"]) -> SplatTable:
    """One Gaussian for each group; a group of one stays as it is. Extra columns are those of its
    heaviest member."""
    count = int(label.max()) + 1
    size = np.bincount(label, minlength=count)
    alone = size[label] == 1
    single = np.flatnonzero(alone)
    rows = np.flatnonzero(~alone)
    if not len(rows):
        return table
    _, group = np.unique(label[rows], return_inverse=True)
    joined = _represent(table[rows], group)
    place = np.empty(count, np.int64)
    place[label[single]] = np.arange(len(single))
    place[np.unique(label[rows])] = len(single) + np.arange(len(joined))
    return concatenate_tables([table[single], joined])[place]


def mean_area(scales: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Mean area of an ellipsoid's shadow over all directions, in units of pi; within 1.1 %.

    Thomsen's formula for the surface of an ellipsoid, p = 1.6075; the mean shadow of a convex body
    is a quarter of its surface (Cauchy).
    """
    a, b, c = scales.astype(np.float64).T ** 1.6075
    return ((a * b + a * c + b * c) / 3) ** (1 / 1.6075)


def _represent(table: SplatTable, group: Int[np.ndarray, " n"]) -> SplatTable:
    """One Gaussian for each of the groups 0, 1, ..., by the moments of its mixture."""
    single = moments_of(table)
    mass = np.bincount(group, single.mass)
    weight = single.mass / mass[group]

    def total(values: Float[np.ndarray, " n"]) -> Float64[np.ndarray, " g"]:
        return np.bincount(group, weight * values)

    mean = np.stack([total(single.mean[:, i]) for i in range(3)], 1)
    apart = single.mean - mean[group]
    second = single.covariance + apart[:, :, None] * apart[:, None]
    flat = second.reshape(-1, 9)
    covariance = np.stack([total(flat[:, i]) for i in range(9)], 1).reshape(-1, 3, 3)
    values, quats = principal_axes(covariance)
    scales = np.sqrt(np.maximum(values, np.square(1e-6 * np.sqrt(values[:, 2:]))))
    opacity = np.clip(mass / mean_area(scales), 1e-6, MAX_OPACITY)
    heaviest = np.lexsort((-single.mass, group))
    heaviest = heaviest[np.unique(group[heaviest], return_index=True)[1]]
    k = table.sh.shape[1]
    flat = table.sh.reshape(len(table), -1)
    sh = np.stack([total(flat[:, i]) for i in range(3 * k)], 1).reshape(-1, k, 3)
    return SplatTable(
        mean.astype(np.float32),
        quats.astype(np.float32),
        np.log(np.maximum(scales, 1e-30)).astype(np.float32),
        np.log(opacity / (1 - opacity)).astype(np.float32),
        sh.astype(np.float32),
        {name: column[heaviest] for name, column in table.extra.items()},
    )


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
"""Longer side, pixels, and number of the pictures that tell what differs."""
METHODS = ("merge", "importance", "random")


@dataclass(frozen=True, eq=False)
class Decimate(Whole):
    """Leave a number of Gaussians, or a share of them.

    `merge` joins near ones; `importance` keeps those of most opacity
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
    from gsedit.views.orbit import orbit
    from rasterizer.render import render_picture

    scene, other = gaussians_of(before), gaussians_of(after)
    cameras = orbit(scene, VIEWS, SIZE) if cameras is None else cameras
    chosen = [each.fitted(SIZE) for each in cameras[:: -(-len(cameras) // VIEWS)]]
    pairs = ((render_picture(other, each), render_picture(scene, each)) for each in chosen)
    rmse = pooled_rmse(squared_error(*pair) for pair in pairs)
    return psnr_from_rmse(rmse or 0.0)
