"""Bring a scene to the ground, to a known length, or onto another scene.

Open3D registers one scene to another, by centers and colors of splats. The clouds are thinned to
even density and scaled to one spread. First guesses come from their principal axes, the best ones
again at other scales and places. Each is improved by closest points; the one in which most points
find a partner, in position and color, is improved further on more points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.formats.streams import SceneHeader
from gsedit.formats.usd.file import rescaled
from gsedit.run.environment import load_extra
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.planes import Plane, voted_plane
from gsedit.scene.quaternions import AXES, quaternion_of, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit.decimate import importance
from gsedit.toolkit.operation import Say, Whole
from gsedit.toolkit.transform import scale

COARSE, FINE = 1500, 10_000
"""Points a cloud that guesses are tried on, and that the best ones are compared on."""
MOST = 100_000
"""Points a cloud of the last step: of more, every second, third, ... is taken."""
COLOR = 0.15
"""Color difference that counts as much as the distance at which points are partners."""
FINALISTS = 5
"""Guesses that are compared on more points."""
RATIOS = (0.8, 1.0, 1.25)
"""Relative scales at which the best guesses are tried again: parts of a scene differ in spread."""
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
    a, b, cell = _thinned(small, large, COARSE)
    found = _best(o3d, a, b, [*_by_axes(a, b)], (8 * cell, 4 * cell, 2 * cell))[:FINALISTS]
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
    for ratio, step in product(RATIOS, SLIDES):
        yield Similarity(np.eye(3), ratio, step * axis).about(middle).after(guess)


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


LEAST_SHARE = 0.02
"""Share of the splats that a ground holds."""
TILT = 35.0
"""Degrees that the ground may lean against an upward direction that is given."""


def find_ground(table: SplatTable, up: Float64[np.ndarray, "3"]) -> tuple[Plane, float, float]:
    """The plane with most splats on it times the share of the others above it; its share of the
    splats, by opacity times area, and the share of the others that lie above.

    Its normal is at most TILT from `up`. Raises UsageError where no plane holds LEAST_SHARE.
    """
    points = _sample(table)
    thickness = 0.01 * float(np.median(np.linalg.norm(points - np.median(points, 0), axis=1)))
    voters = points[:4_000]

    def votes(normals: np.ndarray, offsets: np.ndarray, on: np.ndarray) -> np.ndarray:
        rise, share = normals @ up, on.mean(0)
        over = ((voters @ normals.T - offsets) * np.sign(rise) > thickness).mean(0)
        level = np.abs(rise) > np.cos(np.radians(TILT))
        return level * share * (over / np.maximum(1 - share, 1e-9)) ** 4

    # with one splat in seven on the ground, 5 or more fit it
    found = voted_plane(voters, thickness, np.random.default_rng(0), votes, tries=2_000)
    plane = None if found is None else found[0].turned(up)
    heights = np.zeros(0) if plane is None else plane.heights(points)
    share = float(np.mean(np.abs(heights) < thickness)) if len(heights) else 0.0
    if plane is None or share < LEAST_SHARE:
        raise UsageError("no ground was found: name what is up, or turn by transform --rotate")
    return plane, share, float(np.mean(heights > thickness)) / max(1 - share, 1e-9)


def _sample(table: SplatTable) -> Float64[np.ndarray, "n 3"]:
    weight = np.nan_to_num(importance(table), posinf=0.0) * np.isfinite(table.means).all(1)
    if np.count_nonzero(weight) < 10:
        raise UsageError("a scene of so few visible splats has no ground")
    # giants must not decide alone
    weight = np.minimum(weight, 10 * np.median(weight[weight > 0]))
    rows = np.random.default_rng(0).choice(len(weight), 20_000, p=weight / weight.sum())
    return table.means[rows].astype(np.float64)


@dataclass(frozen=True, eq=False)
class Align(Whole):
    """An operation that finds where the scene is to go, and moves it there."""

    cameras: bool = field(default=False, kw_only=True)
    """Whether the cameras beside the scene's file are to move along."""
    found: list[Similarity] = field(default_factory=list, repr=False, kw_only=True)
    save: Path | None = field(default=None, kw_only=True)
    """The .json to write the similarity to."""

    @property
    def moves(self) -> bool:
        return True

    @property
    def moved(self) -> Similarity:
        """The similarity that was applied to the scene; known after the work."""
        return self.found[-1] if self.found else IDENTITY

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        similarity = self.find(table, say)
        self.found.append(similarity)
        say(describe(similarity))
        return similarity.table(table)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        """Find the similarity that moves the scene to its new place."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class AlignToGround(Align):
    """Turn the scene so that its ground is level, and move it there along the upward axis.

    `up` is the axis that then points up; `near` the direction that is up now, within 35 degrees
    (None: up in the views that are found of the scene).
    """

    up: str = "-y"
    near: str | None = None

    def __post_init__(self) -> None:
        for axis in (self.up, self.near or "y"):
            if axis not in AXES:
                raise UsageError(f"axis {axis}: {', '.join(AXES)} are possible")

    def find(self, table: SplatTable, say: Say) -> Similarity:
        if self.near is None:
            from gsedit.views.around import cameras_of
            from gsedit.views.paths import up_of

            near = up_of(cameras_of(gaussians_of(table), size=64)).double().numpy()
        else:
            near = AXES[self.near]
        plane, share, above = find_ground(table, near)
        axis = AXES[self.up]
        tilt = float(np.degrees(np.arccos(np.clip(plane.normal @ axis, -1, 1))))
        say(
            f"the ground leans {tilt:.2f} degrees against {self.up}; it holds "
            f"{100 * share:.0f} % of the scene, {100 * above:.0f} % of the rest above"
        )
        return Similarity(turn_between(plane.normal, axis), 1.0, -plane.offset * axis)


@dataclass(frozen=True, eq=False)
class AlignTo(Align):
    """Lay the scene on another one: gsedit.toolkit.align."""

    other: SplatTable

    def header(self, header: SceneHeader) -> SceneHeader:
        return rescaled(header, None)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        match = register(table, self.other)
        say(
            f"{100 * match.overlap:.0f} % of its splats lie on the other scene, "
            f"{match.residual:.4g} units off (root mean square)"
        )
        if match.overlap < 0.2:
            say("so few that the two may not show the same thing: look at the result")
        return match.similarity


@dataclass(frozen=True, eq=False)
class AlignLength(Align):
    """Scale the scene about the origin so that two of its points are a length apart."""

    first: Sequence[float]
    second: Sequence[float]
    length: float

    def header(self, header: SceneHeader) -> SceneHeader:
        return rescaled(header, None)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        apart = float(np.linalg.norm(np.subtract(self.first, self.second)))
        if not apart:
            raise UsageError("the two points of a known length are the same")
        say(f"the points are {apart:.6g} apart")
        return scale(self.length / apart)


def describe(similarity: Similarity) -> str:
    """Describe a similarity in one line, for a person."""
    turn = -similarity.turn if similarity.mirrors else similarity.turn
    degrees = 2 * np.degrees(np.arccos(min(quaternion_of(turn)[0], 1.0)))
    move = ", ".join(f"{value:.6g}" for value in similarity.translation)
    return f"scaled by {similarity.scale:.6g}, turned by {degrees:.2f} degrees, moved by {move}"
