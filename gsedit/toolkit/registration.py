"""Register one scene to another: find a similarity from the centers and colors of splats.

The clouds are thinned to even density and scaled to one spread. First guesses come from their
principal axes and, where Open3D loads, from its matching of FPFH descriptors at several relative
scales. Each is improved by closest points in position and color, both ways and trimmed; the one in
which most points find a partner is improved further on all points. numpy and scipy, float64.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product
from typing import Any

import numpy as np
from jaxtyping import Float64, Int

from gsedit.errors import GseditError, UsageError
from gsedit.runs.environment import load_package
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import SplatTable

COARSE = 1500
"""Points a cloud that first guesses are tried on."""
MIDDLE = 6000
"""Points a cloud that decide between the best guesses."""
FINE = 20_000
"""Points a cloud of the last steps."""
COLOR = 0.15
"""Color difference that counts as much as the distance at which points are partners."""
GUESSES = 8
"""First guesses that are improved further."""
SLIDES = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""Places along the longest axis, in spreads, where the best guesses are tried again, each at three
scales: of a part of a long thing, the middle and the spread say little."""
FINALISTS = 3
"""Number of guesses that are compared on more points."""
RATIOS = (0.63, 0.8, 1.0, 1.25, 1.6)
"""Relative scales at which descriptors are matched: parts of a scene differ in spread."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points with colors, in units in which the scene's spread is 1."""

    points: Float64[np.ndarray, "n 3"]
    colors: Float64[np.ndarray, "n 3"]

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, similarity: Similarity) -> Cloud:
        return Cloud(similarity.points(self.points), self.colors)


@dataclass(frozen=True, eq=False)
class Match:
    """How a scene was laid on another."""

    similarity: Similarity
    residual: float
    """Root mean square distance of the points that found a partner, units of the other scene."""
    overlap: float
    """Share of its points that found one."""


def register(source: SplatTable, target: SplatTable) -> Match:
    """The similarity that lays `source` on `target`. Deterministic.

    Raises UsageError where a scene has too few visible splats.
    """
    (small, into), (large, onto) = normalised(source), normalised(target)
    best = _coarse(small, large)
    (a, ours), (b, theirs) = thinned(small, FINE), thinned(large, FINE)
    cell = max(ours, theirs)
    best = closest_points(a, b, best, np.geomspace(3 * cell, 1.5 * cell, 12))
    every, everything = _at_most(small, FINE), _at_most(large, 10 * FINE)
    best = closest_points(every, everything, best, np.geomspace(2 * cell, cell, 6), both=False)
    distance, _ = _nearest(every.moved(best), everything, 2 * cell)
    near = distance[distance < 2 * cell]
    whole = onto.inverse.after(best).after(into)
    rms = float(np.sqrt(np.mean(near**2))) if len(near) else float("nan")
    return Match(whole, rms * onto.inverse.scale, len(near) / len(every))


def _coarse(small: Cloud, large: Cloud) -> Similarity:
    """The best of the guesses, at the density of MIDDLE points."""
    (a, ours), (b, theirs) = thinned(small, COARSE), thinned(large, COARSE)
    cell = max(ours, theirs)
    found = [(score(a.moved(s), b, 2 * cell), s) for s in _improved(a, b, cell)]
    found.sort(key=lambda pair: -pair[0])
    for slid in [each for _, guess in found[:4] for each in _slid(a, b, guess)]:
        better = closest_points(_at_most(a, 400), b, slid, np.geomspace(3 * cell, 1.5 * cell, 6))
        found.append((score(a.moved(better), b, 2 * cell), better))
    for count, keep in ((COARSE, GUESSES), (MIDDLE, FINALISTS)):
        found.sort(key=lambda pair: -pair[0])
        (a, ours), (b, theirs) = thinned(small, count), thinned(large, count)
        cell = max(ours, theirs)
        radii = np.geomspace(3 * cell, cell, 12)
        better = [closest_points(a, b, guess, radii) for _, guess in found[:keep]]
        found = [(score(a.moved(each), b, cell), each) for each in better]
    return max(found, key=lambda pair: pair[0])[1]


def normalised(table: SplatTable) -> tuple[Cloud, Similarity]:
    """The visible splats in units of their spread about their middle, and how they got there."""
    keep = np.isfinite(table.means).all(1) & np.isfinite(table.colors).all(1)
    keep &= table.opacities > 0.1
    if keep.sum() < 30:
        raise UsageError("a scene of so few visible splats cannot be laid on another")
    points = table.means[keep].astype(np.float64)
    middle = np.median(points, 0)
    spread = float(np.median(np.linalg.norm(points - middle, axis=1)))
    if not spread:
        raise UsageError("a scene whose splats are at one place cannot be laid on another")
    near = np.linalg.norm(points - middle, axis=1) < 6 * spread
    similarity = Similarity(np.eye(3), 1 / spread, -middle / spread)
    colors = np.clip(table.colors[keep][near].astype(np.float64), 0, 1)
    return Cloud(similarity.points(points[near]), colors), similarity


def thinned(cloud: Cloud, count: int) -> tuple[Cloud, float]:
    """About `count` points of even density, the means of cells, and the side of a cell; at most
    half as many as there are."""
    count = min(count, len(cloud) // 2)
    low, high = 1e-4, 4.0
    for _ in range(14):
        side = float(np.sqrt(low * high))
        cells = len(np.unique(_cells(cloud, side)))
        low, high = (low, side) if cells < count else (side, high)
    cells, group = np.unique(_cells(cloud, high), return_inverse=True)
    size = np.bincount(group)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(group, column) / size for column in values.T], 1)

    return Cloud(mean(cloud.points), mean(cloud.colors)), high


def _cells(cloud: Cloud, side: float) -> Int[np.ndarray, " n"]:
    index = np.floor(cloud.points / side).astype(np.int64) + (1 << 20)
    return (index[:, 0] << 42) | (index[:, 1] << 21) | index[:, 2]


def _at_most(cloud: Cloud, count: int) -> Cloud:
    rows = np.random.default_rng(0).permutation(len(cloud))[:count]
    return Cloud(cloud.points[rows], cloud.colors[rows])


def _improved(a: Cloud, b: Cloud, cell: float) -> Iterator[Similarity]:
    """First guesses, each after a few steps."""
    few = _at_most(a, 400)
    for guess in (*_by_axes(a, b), *_by_descriptors(a, b, cell)):
        yield closest_points(few, b, guess, np.geomspace(8 * cell, 3 * cell, 8))


def _slid(a: Cloud, b: Cloud, guess: Similarity) -> Iterator[Similarity]:
    """A guess at other scales and other places along the longest axis of `b`."""
    axis = np.linalg.svd(b.points - b.points.mean(0), False)[2][0]
    middle = guess.points(a.points.mean(0)[None])[0]
    for ratio, step in product((0.8, 1.0, 1.25), SLIDES):
        yield Similarity(np.eye(3), ratio, step * axis).about(middle).after(guess)


def _by_axes(a: Cloud, b: Cloud) -> Iterator[Similarity]:
    """The 24 ways to lay principal axes on principal axes."""
    first, second = (np.linalg.svd(c.points - c.points.mean(0), False)[2].T for c in (a, b))
    middle, place = a.points.mean(0), b.points.mean(0)
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = second[:, list(order)] * signs @ first.T
        if np.linalg.det(turn) > 0:
            yield Similarity(turn, 1.0, place - turn @ middle)


def has_descriptors() -> bool:
    """Whether Open3D loads, whose descriptors give first guesses."""
    try:
        load_package("open3d", "", "")
    except GseditError:
        return False
    return True


def _by_descriptors(a: Cloud, b: Cloud, cell: float) -> Iterator[Similarity]:
    """Guesses from Open3D's RANSAC over matches of FPFH descriptors; none where Open3D does not
    load."""
    if not has_descriptors():
        return
    import open3d as o3d

    registration = o3d.pipelines.registration
    o3d.utility.random.seed(0)
    prepare = partial(_described, o3d)
    target, theirs = prepare(b.points, cell)
    for ratio in RATIOS:
        points, ours = prepare(a.points * ratio, cell)
        result = registration.registration_ransac_based_on_feature_matching(
            points, target, ours, theirs, False, 2 * cell,
            registration.TransformationEstimationPointToPoint(True), 4,
            [registration.CorrespondenceCheckerBasedOnDistance(2 * cell)],
            registration.RANSACConvergenceCriteria(20_000, 0.999),
        )  # fmt: skip
        matrix = np.asarray(result.transformation)
        scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        if scale > 0:
            found = Similarity(matrix[:3, :3] / scale, scale, matrix[:3, 3].copy())
            yield found.after(Similarity(np.eye(3), ratio, np.zeros(3)))


def _described(o3d: Any, points: Float64[np.ndarray, "n 3"], cell: float) -> tuple[Any, Any]:
    """An Open3D cloud and its FPFH descriptors."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    near, wide = (o3d.geometry.KDTreeSearchParamHybrid(r * cell, n) for r, n in ((3, 30), (6, 100)))
    cloud.estimate_normals(near)
    cloud.orient_normals_to_align_with_direction()
    return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, wide)


def closest_points(
    a: Cloud,
    b: Cloud,
    guess: Similarity,
    radii: Float64[np.ndarray, " steps"],
    *,
    both: bool = True,
) -> Similarity:
    """Improve a similarity: the partners of points within a radius, in position and color; those
    of the other cloud's points too if `both`, which keeps a poor guess from shrinking."""
    similarity = guess
    for radius in radii.tolist():
        moved = a.moved(similarity)
        there, partner = _nearest(moved, b, radius)
        ours, theirs, origin = np.flatnonzero(there < radius), np.empty(0, int), np.empty(0, int)
        if both:
            back, origin = _nearest(b, moved, radius)
            theirs = np.flatnonzero(back < radius)
        if len(ours) + len(theirs) < 10:
            return similarity
        start = np.concatenate([moved.points[ours], moved.points[origin[theirs]]])
        end = np.concatenate([b.points[partner[ours]], b.points[theirs]])
        similarity = fitted(start, end).after(similarity)
    return similarity


def _nearest(
    a: Cloud, b: Cloud, radius: float
) -> tuple[Float64[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """For each point of `a`, find the nearest point of `b` in position and color together. Returns
    its distance in space (infinite beyond the radius) and its row."""
    from scipy.spatial import KDTree

    weight = radius / COLOR
    tree = KDTree(np.concatenate([b.points, weight * b.colors], 1))
    distance, index = tree.query(
        np.concatenate([a.points, weight * a.colors], 1), distance_upper_bound=1.5 * radius
    )
    found = np.isfinite(distance)
    index = np.where(found, index, 0)
    apart = np.linalg.norm(a.points - b.points[index], axis=1)
    return np.where(found, apart, np.inf), index


def score(a: Cloud, b: Cloud, radius: float) -> float:
    """Harmonic mean of the shares of both clouds that find a partner."""
    one = float(np.mean(_nearest(a, b, radius)[0] < radius))
    other = float(np.mean(_nearest(b, a, radius)[0] < radius))
    return 2 * one * other / max(one + other, 1e-9)


def fitted(start: Float64[np.ndarray, "n 3"], end: Float64[np.ndarray, "n 3"]) -> Similarity:
    """The similarity without a mirror that brings points to points, in the least squares sense.

    Umeyama 1991, with Horn's symmetric scale: a ratio of spreads, which noise does not shrink.
    """
    a, b = start - start.mean(0), end - end.mean(0)
    u, values, v = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    if not values[0]:
        return IDENTITY
    turn = (u * sign) @ v
    scale = float(np.sqrt((b**2).sum() / (a**2).sum()))
    return Similarity(turn, scale, end.mean(0) - scale * (turn @ start.mean(0)))
