"""Correspondences: latent cells of several views that show one piece of surface, by rendered depth.

`v` views of `h w` pixels, `y x` latent cells of `cell` pixels, `n` = y x cells in a view,
`m` pairs, `p` positions. xy is in pixels, the corner of the first pixel at (0, 0). Depth
is along the view, 0 where nothing was rendered: the rendered *median* depth of the unedited scene.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.views.depth_maps import (
    DEFAULT_RULES,
    Visibility,
    clip_to_picture,
    fit_planes,
    has_depth,
    surface_at,
)
from rasterizer.camera import Camera


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Clusters of latent cells, at most one a view, that show the same piece of surface."""

    labels: Int[Tensor, "v y x"]
    """Cluster of each cell, 0 ... count - 1 in order of first appearance; -1: in no cluster."""
    matched: Float[Tensor, "v v"]
    """Fraction of all cells of view a (row) with an accepted match in b (column); diagonal 1."""
    cell: int
    """Pixels per cell side."""

    @property
    def count(self) -> int:
        """Number of the clusters."""
        return int(self.labels.max()) + 1 if self.labels.numel() else 0

    @property
    def covered(self) -> Float[Tensor, " v"]:
        """Fraction of each view's cells that are in some cluster."""
        return (self.labels >= 0).double().mean((1, 2))


class Pairs(NamedTuple):
    """Accepted mutual matches of two views."""

    a: Int[Tensor, " m"]
    """Row-major cell index in view a, ascending; each occurs once."""
    b: Int[Tensor, " m"]
    """Row-major cell index in view b; each occurs once."""
    error: Float[Tensor, " m"]
    """Cells, along either axis: how far the center of either cell lands from the other's."""


@torch.no_grad()  # which cells belong together is an integer question
def correspond(
    cameras: Sequence[Camera],
    depths: Float[Tensor, "v h w"],
    alphas: Float[Tensor, "v h w"],
    *,
    cell: int = 8,
    rules: Visibility = DEFAULT_RULES,
) -> Correspondences:
    """Clusters of corresponding cells of all views.

    The mutual pairs of all v (v - 1) / 2 pairs of views are merged by union-find, smallest error
    first; a merge that would put two cells of one view into a cluster is refused. Raises
    UsageError when the pictures do not divide into cells or are not their cameras'.
    """
    views = len(depths)
    grid = _grid(depths, cell)
    surfaces = [
        cell_surfaces(*view, cell, rules) for view in zip(cameras, depths, alphas, strict=True)
    ]
    matched = torch.eye(views, dtype=torch.float64)
    pairs = {}
    for a, b in itertools.combinations(range(views), 2):
        pairs[a, b] = mutual(surfaces[a], surfaces[b], rules)
        matched[a, b] = matched[b, a] = len(pairs[a, b].a) / (grid[0] * grid[1])
    labels = _merge(pairs, views, grid[0] * grid[1])
    return Correspondences(labels.reshape(views, *grid), matched, cell)


class CellSurfaces(NamedTuple):
    """One view, and the surface at the center of each of its cells."""

    camera: Camera
    depth: Float[Tensor, "h w"]
    """float64, so that rounding never decides a match."""
    alpha: Float[Tensor, "h w"]
    cell: int
    xy: Float[Tensor, "n 2"]
    """Centers of the cells, pixels."""
    z: Float[Tensor, " n"]
    """Depth at the cell centers; 1 where not solid."""
    slope: Float[Tensor, "n 2"]
    """Slope of 1 / depth along x and y, per pixel: the tilt of the surface."""
    solid: Bool[Tensor, " n"]
    """One opaque surface fills the cell."""


def cell_surfaces(
    camera: Camera,
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    cell: int,
    rules: Visibility,
) -> CellSurfaces:
    """The cells of one view. Raises UsageError for a depth map that is not its camera's."""
    rows, columns = _grid(depth[None], cell)
    if depth.shape != (camera.height, camera.width):
        raise UsageError(
            f"A depth map has {depth.shape[1]}x{depth.shape[0]} pixels and its camera "
            f"{camera.width}x{camera.height}; resize the camera with Camera.resized."
        )
    depth = depth.double()
    opaque = (alpha > rules.min_alpha) & has_depth(depth)
    solid = opaque.reshape(rows, cell, columns, cell).all(3).all(1)
    slope, spread = fit_planes(torch.where(opaque, 1 / depth, 0.0), cell)
    solid &= spread <= rules.silhouette
    grid = replace(camera, width=columns, height=rows)
    xy = grid.pixel_centers().reshape(-1, 2) * cell
    z, smooth = surface_at(depth, alpha, xy, rules)
    solid = solid.reshape(-1) & smooth
    return CellSurfaces(camera, depth, alpha, cell, xy, z, slope.reshape(-1, 2), solid)


def mutual(a: CellSurfaces, b: CellSurfaces, rules: Visibility) -> Pairs:
    """Pairs of cells that are each other's nearest and that every rule accepts both ways."""
    there, error_there, good_there = _carry(a, b, rules)
    back, error_back, good_back = _carry(b, a, rules)
    own = torch.arange(len(there))
    error = torch.maximum(error_there, error_back[there])
    mutual = (back[there] == own) & good_there & good_back[there]
    return Pairs(own[mutual], there[mutual], error[mutual])


def _carry(
    a: CellSurfaces, b: CellSurfaces, rules: Visibility
) -> tuple[Int[Tensor, " n"], Float[Tensor, " n"], Bool[Tensor, " n"]]:
    """For each cell of a: nearest cell of b, displacement from its center in cells, acceptable."""
    points = a.camera.unproject(a.xy, a.z)
    xy, z = b.camera.project(points)
    xy, inside = clip_to_picture(xy, z, b.camera)
    column, row = (xy / b.cell).long().unbind(-1)
    index = row * (b.camera.width // b.cell) + column
    depth, smooth = surface_at(b.depth, b.alpha, xy, rules)
    agrees = (z - depth).abs() <= rules.depth_agreement * depth
    returned, _ = a.camera.project(b.camera.unproject(xy, depth))
    agrees &= (returned - a.xy).norm(dim=-1) <= rules.round_trip * a.cell
    rays = [points - camera.center.to(points) for camera in (a.camera, b.camera)]
    agrees &= torch.cosine_similarity(*rays, dim=-1) >= cos(radians(rules.angle))
    small, large = _stretch(a, b)
    alike = (large <= rules.footprint) & (small >= 1 / rules.footprint)
    displacement = (xy - b.xy[index]).abs().amax(-1) / b.cell
    good = a.solid & inside & b.solid[index] & smooth & agrees & alike
    return index, displacement, good


def _stretch(a: CellSurfaces, b: CellSurfaces) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """(smallest, largest) length in b, in cells, of a line across a cell of a, on its plane.

    The singular values of the map between the pictures; the smallest is negative where b would see
    the surface from behind.
    """
    ends = []
    for step in a.xy.new_tensor(((0.5, 0.0), (0.0, 0.5))) * a.cell:
        there = [
            b.camera.project(a.camera.unproject(a.xy + side, 1 / (1 / a.z + a.slope @ side)))[0]
            for side in (step, -step)
        ]
        ends.append((there[0] - there[1]) / b.cell)
    (xx, xy), (yx, yy) = (end.unbind(-1) for end in ends)
    square, area = xx**2 + xy**2 + yx**2 + yy**2, xx * yy - xy * yx
    total, rest = ((square + side * 2 * area).clamp_min(0).sqrt() for side in (1, -1))
    return (total - rest) / 2, (total + rest) / 2


def _grid(depths: Float[Tensor, "v h w"], cell: int) -> tuple[int, int]:
    """(rows, columns) of cells. Raises UsageError where the picture does not divide into them."""
    _, height, width = depths.shape
    if cell < 1 or height % cell or width % cell or not height or not width:
        raise UsageError(
            f"A picture of {width}x{height} pixels does not divide into cells of {cell}; "
            f"make both sides multiples of {cell}."
        )
    return height // cell, width // cell


def _merge(pairs: dict[tuple[int, int], Pairs], views: int, per_view: int) -> Int[Tensor, " vn"]:
    """Labels from pairs: greedy union-find, smallest error first, one cell per view and cluster."""
    labels = torch.full((views * per_view,), -1, dtype=torch.int64)
    if not pairs:
        return labels
    error = torch.cat([p.error for p in pairs.values()])
    order = error.argsort(stable=True)  # ties keep the order of views and cells
    left = torch.cat([p.a + a * per_view for (a, _), p in pairs.items()])[order].tolist()
    right = torch.cat([p.b + b * per_view for (_, b), p in pairs.items()])[order].tolist()
    parent = list(range(views * per_view))
    occupied = [1 << (node // per_view) for node in parent]  # bit set of a cluster's views

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = node = parent[parent[node]]
        return node

    for one, other in zip(left, right, strict=True):
        one, other = sorted((root(one), root(other)))
        if not occupied[one] & occupied[other]:
            parent[other] = one
            occupied[one] |= occupied[other]
    names: dict[int, int] = {}
    for node in sorted({*left, *right}):
        if occupied[root(node)].bit_count() > 1:  # a cell whose merges were all refused is alone
            labels[node] = names.setdefault(root(node), len(names))
    return labels
