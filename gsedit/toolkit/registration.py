"""Register one scene to another by Open3D: find a similarity from centers and colors of splats.

The clouds are thinned to even density and scaled to one spread. First guesses come from their
principal axes and from RANSAC over matches of FPFH descriptors at several relative scales. Each is
improved by closest points; the one in which most points find a partner, in position and color, is
improved further on more points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.run.environment import load_extra
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.similarity import Similarity, similarity_of
from gsedit.scene.table import SplatTable

COARSE, FINE = 1500, 10_000
"""Points a cloud that guesses are tried on, and that the best ones are compared on."""
MOST = 100_000
"""Points a cloud of the last step: of more, every second, third, ... is taken."""
COLOR = 0.15
"""Color difference that counts as much as the distance at which points are partners."""
FINALISTS = 5
"""Guesses that are compared on more points."""
RATIOS = (0.63, 0.8, 1.0, 1.25, 1.6)
"""Relative scales at which descriptors are matched: parts of a scene differ in spread."""
SLIDES = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""Places along the longest axis, in spreads, where the best guesses are tried again, each at three
scales: of a part of a long thing, the middle and the spread say little."""


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

    Raises UsageError where a scene has too few visible splats, GseditError without Open3D.
    """
    o3d = load_extra("open3d", "to lay a scene on another one")
    (small, into), (large, onto) = (normalised(o3d, each) for each in (source, target))
    o3d.utility.random.seed(0)
    a, b, cell = _thinned(small, large, COARSE)
    guesses = [*_by_axes(a, b), *_by_descriptors(o3d, a, b, cell)]
    found = _best(o3d, a, b, guesses, (8 * cell, 4 * cell, 2 * cell))[:FINALISTS]
    slid = [each for guess in found for each in _slid(a, b, guess)]
    found = _best(o3d, a, b, [*found, *slid], (4 * cell, 2 * cell))[:FINALISTS]
    a, b, cell = _thinned(small, large, FINE)
    best = _best(o3d, a, b, found, (3 * cell, 1.5 * cell))[0]
    best = _improved(o3d, small, large, best, (2 * cell, cell))
    ends = o3d.pipelines.registration.evaluate_registration(small, large, 2 * cell, best.matrix)
    whole = onto.inverse.after(best).after(into)
    return Match(whole, ends.inlier_rmse * onto.inverse.scale, ends.fitness)


def normalised(o3d: Any, table: SplatTable) -> tuple[Any, Similarity]:
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
    vectors = o3d.utility.Vector3dVector
    cloud = o3d.geometry.PointCloud(vectors(similarity.points(points[near])))
    cloud.colors = vectors(colors)
    return cloud.uniform_down_sample(1 + len(colors) // MOST), similarity


def _thinned(small: Any, large: Any, count: int) -> tuple[Any, Any, float]:
    """Both clouds at one even density, at least `count` points each (or half of what there is),
    and the side of the cells whose means they are."""
    cell = 1.0
    while True:
        a, b = small.voxel_down_sample(cell), large.voxel_down_sample(cell)
        pairs = (a, small), (b, large)
        if all(len(few.points) >= min(count, len(all_.points) // 2) for few, all_ in pairs):
            return a, b, cell
        cell *= 0.85


def _by_axes(a: Any, b: Any) -> Iterator[Similarity]:
    """The 24 ways to lay principal axes on principal axes."""
    (middle, first), (place, second) = (_axes(each) for each in (a, b))
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = second[:, list(order)] * signs @ first.T
        if np.linalg.det(turn) > 0:
            yield Similarity(turn, 1.0, place - turn @ middle)


def _axes(cloud: Any) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3 3"]]:
    """The mean of a cloud, and its principal axes as columns, the longest first."""
    mean, covariance = cloud.compute_mean_and_covariance()
    return mean, np.linalg.eigh(covariance)[1][:, ::-1]


def _slid(a: Any, b: Any, guess: Similarity) -> Iterator[Similarity]:
    """A guess at other scales and other places along the longest axis of `b`."""
    axis = _axes(b)[1][:, 0]
    middle = guess.points(_axes(a)[0][None])[0]
    for ratio, step in product(RATIOS[1:-1], SLIDES):
        yield Similarity(np.eye(3), ratio, step * axis).about(middle).after(guess)


def _by_descriptors(o3d: Any, a: Any, b: Any, cell: float) -> Iterator[Similarity]:
    """Guesses from RANSAC over matches of FPFH descriptors."""
    registration = o3d.pipelines.registration
    target, theirs = _described(o3d, b, 1.0, cell)
    for ratio in RATIOS:
        points, ours = _described(o3d, a, ratio, cell)
        result = registration.registration_ransac_based_on_feature_matching(
            points, target, ours, theirs, False, 2 * cell,
            registration.TransformationEstimationPointToPoint(True), 4,
            [registration.CorrespondenceCheckerBasedOnDistance(2 * cell)],
            registration.RANSACConvergenceCriteria(20_000, 0.999),
        )  # fmt: skip
        found = _similarity(result.transformation)
        if found is not None:
            yield found.after(Similarity(np.eye(3), ratio, np.zeros(3)))


def _described(o3d: Any, cloud: Any, ratio: float, cell: float) -> tuple[Any, Any]:
    """The cloud at another scale, and its FPFH descriptors."""
    cloud = o3d.geometry.PointCloud(cloud).scale(ratio, np.zeros(3))
    near, wide = (o3d.geometry.KDTreeSearchParamHybrid(r * cell, n) for r, n in ((3, 30), (6, 100)))
    cloud.estimate_normals(near)
    cloud.orient_normals_to_align_with_direction()
    return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, wide)


def _best(
    o3d: Any, a: Any, b: Any, guesses: Sequence[Similarity], radii: Sequence[float]
) -> list[Similarity]:
    """The guesses, each improved, the best first: by the harmonic mean of the shares of both clouds
    that have a partner, so that none may shrink into a corner of the other."""
    better = [_improved(o3d, a, b, guess, radii) for guess in guesses]

    def score(similarity: Similarity) -> float:
        moved = o3d.geometry.PointCloud(a).transform(similarity.matrix)
        one, other = _share(moved, b, radii[-1]), _share(b, moved, radii[-1])
        return 2 * one * other / max(one + other, 1e-9)

    return sorted(better, key=score, reverse=True)


def _improved(o3d: Any, a: Any, b: Any, guess: Similarity, radii: Sequence[float]) -> Similarity:
    """A guess after steps of closest points (ICP with scaling) within radii that fall."""
    registration = o3d.pipelines.registration
    for radius in radii:
        result = registration.registration_icp(
            a, b, radius, guess.matrix, registration.TransformationEstimationPointToPoint(True),
            registration.ICPConvergenceCriteria(max_iteration=20),
        )  # fmt: skip
        guess = _similarity(result.transformation) or guess
    return guess


def _similarity(matrix: Any) -> Similarity | None:
    """None where no points were found to fit, or all at one place."""
    try:
        found = similarity_of(np.asarray(matrix))
    except ValueError:
        return None
    return None if found.mirrors else found


def _share(a: Any, b: Any, radius: float) -> float:
    """Share of the points of `a` that have one of `b` near, in position and color together."""
    weight = radius / COLOR
    ours, theirs = (np.hstack((each.points, weight * np.asarray(each.colors))) for each in (a, b))
    return float(np.isfinite(k_nearest(theirs, ours, 1, 1.5 * radius)[0]).mean())
