"""Planes that the surroundings of an object lie on: ground, table, walls. `n` points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64

from gsedit.objects.placing.support import find_support
from gsedit.scene.planes import planes_through, refined_plane
from gsedit.scene.quantiles import extent_of

MOST_PLANES = 4
"""Planes that are looked for: a support and the walls of a corner."""
TRIPLES = 600
VOTERS = 4000
TOLERANCE = 0.01
"""Distance at which a point is on a plane, of the object's extent."""
LEAST_SHARE = 0.15
"""Least share of the surroundings that is on a plane beyond the first."""
SMALLEST = 1e-3
"""Least extent of an object, of its scene's: one Gaussian has none."""
BAND = 3.0
"""Half of the thickness of a plane's layer of Gaussians, in its roughness."""

ALONG = 0.7
"""Least mean cosine between the normals of its Gaussians and a plane beyond the first: those that
it cuts across have 0.5."""
HOVERS = 0.05
"""Height of the object's lowest parts over a plane from which it stands on another, of its extent.
"""
PARALLEL, LAYERS = 0.97, 2.0
"""Cosine of planes that are parallel, and the distance of two layers of one, in their bands."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane with the cameras on its positive side."""

    normal: Float64[np.ndarray, "3"]
    offset: float
    band: float
    """Distance up to which Gaussians belong to it, world units."""

    def heights(self, points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        return points.astype(np.float64) @ self.normal - self.offset

    def on(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points that belong to the plane."""
        return np.abs(self.heights(points)) < self.band


def find_planes(
    points: Float[np.ndarray, "n 3"],
    removed: Bool[np.ndarray, " n"],
    axes: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"],
    eye: Float64[np.ndarray, "3"],
) -> tuple[Plane, ...]:
    """The planes around an object, the one it stands on first; `weights` of its surroundings.

    `eye` is the middle of the cameras, `axes` the shortest axes, as long as a Gaussian is flat.
    """
    extent = max(extent_of(points[removed]), SMALLEST * extent_of(points))
    found = _supports(points, removed, weights, extent, eye)
    left = np.flatnonzero((weights > 0) & ~removed)
    left = left[~np.any([p.on(points[left]) for p in found], 0)] if found else left
    random = np.random.default_rng(0)
    total = weights[~removed].sum()
    for _ in range(MOST_PLANES):
        if len(left) <= 3:
            break
        share = weights[left] / weights[left].sum()
        asked = random.choice(left, VOTERS, p=share)
        voters = points[asked].astype(np.float64)
        plane, votes = _best(voters, extent, eye, random)
        if plane is None or votes * weights[left].sum() < LEAST_SHARE * total:
            break
        if not _along(axes[asked][plane.on(voters)], plane):
            left = left[~plane.on(points[left])]
            continue
        _put(found, plane)
        left = left[~plane.on(points[left])]
    return tuple(found)


def _supports(
    points: Float[np.ndarray, "n 3"],
    removed: Bool[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
    extent: float,
    eye: Float64[np.ndarray, "3"],
) -> list[Plane]:
    """The plane that the object stands on; where it hovers over one, a nearer one below it."""
    found, votes = [], weights.astype(np.float64)
    for _ in range(2):
        support = find_support(points, removed, votes) if votes.any() else None
        if support is None:
            break
        band = max(BAND * support.margin, TOLERANCE * extent)
        plane = _turned(support.normal, support.offset, band, eye)
        lowest = float(np.quantile(support.heights(points[removed]), 0.03))
        found.append((lowest, plane))
        if lowest < HOVERS * extent:
            break
        votes = np.where(plane.on(points), 0.0, votes)
    return [plane for _, plane in sorted(found, key=lambda each: each[0])[:1]]


def _along(axes: Float[np.ndarray, "v 3"], plane: Plane) -> bool:
    """Whether Gaussians lie along a plane, not across: it is a surface, and cuts none."""
    flat = np.linalg.norm(axes, axis=1).sum()
    return bool(np.abs(axes @ plane.normal).sum() > ALONG * flat)


def _put(found: list[Plane], plane: Plane) -> None:
    """Add a plane, or widen the one that it is another layer of: soil under grass."""
    for index, one in enumerate(found):
        apart = abs(plane.offset - one.offset)
        if one.normal @ plane.normal > PARALLEL and apart < LAYERS * (one.band + plane.band):
            found[index] = replace(one, band=max(one.band, apart + plane.band))
            return
    found.append(plane)


def _best(voters, extent: float, eye, random) -> tuple[Plane | None, float]:
    """The plane with most voters, and their share."""
    tolerance = TOLERANCE * extent
    a, b, c = voters[random.integers(len(voters), size=(3, TRIPLES))]
    normals, offsets = planes_through(a, b, c)
    if not len(normals):
        return None, 0.0
    votes = (np.abs(voters @ normals.T - offsets) < tolerance).mean(0)
    best = int(votes.argmax())
    if votes[best] * len(voters) < 3:
        return None, 0.0
    normal, offset = refined_plane(voters, normals[best], float(offsets[best]), tolerance)
    away = np.abs(voters @ normal - offset)
    rough = float(np.median(away[away < tolerance]))
    return _turned(normal, offset, max(BAND * rough, tolerance), eye), float(votes[best])


def _turned(normal, offset: float, band: float, eye) -> Plane:
    side = 1.0 if eye @ normal > offset else -1.0
    return Plane(side * normal, side * offset, band)
