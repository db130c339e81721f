"""Which latent cells of several views show the same piece of surface, through rendered depth.

`v` views of `h w` pixels, `y x` latent cells of `cell` pixels, `n` = y x cells in a view,
`m` pairs, `p` positions. xy is in pixels, the corner of the first pixel at (0, 0). Depth
is along the view, 0 where nothing was drawn: the rendered *median* depth of the unedited scene.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer.camera import Camera


@dataclass(frozen=True)
class Visibility:
    """When two cells are believed to show the same surface. Each rule stops one kind of error."""

    min_alpha: float = 0.9
    """Opacity a pixel needs: below it the depth is a blend of surfaces that are not there."""
    depth_agreement: float = 0.01
    """Largest |z - depth_b| / depth_b: beyond it something else stands in front (occlusion)."""
    round_trip: float = 0.5
    """Largest displacement there and back, in cells along either axis: the point stays in its
    cell. Nearest-cell rounding alone reaches 0.5, so less would leave periodic holes."""
    silhouette: float = 0.05
    """Largest relative spread of 1 / depth in a cell about its best plane (a step keeps its whole
    height, a slope has none), and of depth between neighbours: beyond it there are two surfaces."""
    footprint: float = 2.0
    """Largest ratio, either way, of the sizes in the world of the two cells: beyond it one cell
    holds several of the other, and one value cannot stand for all."""


DEFAULT_RULES = Visibility()
ROUNDING = 1e-6
"""Pixels: a position on the border of a picture is inside it, whatever float64 makes of it."""


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
        """Number of clusters."""
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
    """Round trip in cells: the larger of the two directions' displacements along either axis."""


# ---- geometry: from depth maps to pairs, from pairs to clusters ---------------------------------


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

    The mutual pairs of all v (v - 1) / 2 pairs of views are merged by union-find, best round trip
    first; a merge that would put two cells of one view into a cluster is refused. Raises UsageError
    when the pictures do not divide into cells or are not their cameras'.
    """
    views = len(depths)
    grid = _grid(depths, cell)
    seen = [_look(*view, cell, rules) for view in zip(cameras, depths, alphas, strict=True)]
    matched = torch.eye(views, dtype=torch.float64)
    pairs = {}
    for a, b in itertools.combinations(range(views), 2):
        pairs[a, b] = _mutual(seen[a], seen[b], rules)
        matched[a, b] = matched[b, a] = len(pairs[a, b].a) / (grid[0] * grid[1])
    labels = _merge(pairs, views, grid[0] * grid[1])
    return Correspondences(labels.reshape(views, *grid), matched, cell)


@torch.no_grad()
def match(
    camera_a: Camera,
    depth_a: Float[Tensor, "h w"],
    alpha_a: Float[Tensor, "h w"],
    camera_b: Camera,
    depth_b: Float[Tensor, "h2 w2"],
    alpha_b: Float[Tensor, "h2 w2"],
    cell: int = 8,
    rules: Visibility = DEFAULT_RULES,
) -> Pairs:
    """Mutual matches between the cells of two views; symmetric in them. Raises UsageError.

    The centre of each cell is carried through the world to the other view and takes the *nearest*
    cell there (interpolating noise would lower its variance). A pair is accepted when each cell is
    the other's nearest and every rule of `Visibility` holds in both directions.
    """
    a = _look(camera_a, depth_a, alpha_a, cell, rules)
    b = _look(camera_b, depth_b, alpha_b, cell, rules)
    return _mutual(a, b, rules)


def warp(
    image_b: Float[Tensor, "h2 w2 k"],
    camera_a: Camera,
    depth_a: Float[Tensor, "h w"],
    alpha_a: Float[Tensor, "h w"],
    camera_b: Camera,
    depth_b: Float[Tensor, "h2 w2"],
    alpha_b: Float[Tensor, "h2 w2"],
    rules: Visibility = DEFAULT_RULES,
) -> tuple[Float[Tensor, "h w k"], Bool[Tensor, "h w"]]:
    """View b's picture as seen from a (bilinear, through a's depth), and where that is valid.

    Valid: both views opaque, no silhouette under the sample, depths agree, and b's depth carries
    the point back to within one pixel of its start. Differentiable in `image_b`; 0 where invalid.
    """
    with torch.no_grad():
        depth_a, depth_b = depth_a.double(), depth_b.double()
        centres = camera_a.pixel_centres()
        solid = (alpha_a > rules.min_alpha) & _drawn(depth_a)
        start = torch.where(solid, depth_a, 1.0)
        xy, z = camera_b.project(camera_a.unproject(centres, start))
        xy, inside = _clip(xy, z, camera_b, margin=0.5)  # between pixel centres
        there, opaque = _surface(depth_b, alpha_b, xy, rules)
        back, _ = camera_a.project(camera_b.unproject(xy, there))
        returns = (back - centres).abs().amax(-1) < 1
        agrees = (z - there).abs() <= rules.depth_agreement * there
        valid = solid & inside & opaque & agrees & returns
        size = xy.new_tensor((camera_b.width, camera_b.height))
        sample = (2 * xy / size - 1)[None].to(image_b)  # align_corners=False: corners at -1 and 1
    seen = F.grid_sample(
        image_b.permute(2, 0, 1)[None], sample, padding_mode="border", align_corners=False
    )
    return seen[0].permute(1, 2, 0) * valid[..., None], valid


class _Seen(NamedTuple):
    """One view with its cells."""

    camera: Camera
    depth: Float[Tensor, "h w"]
    """float64, so that rounding never decides a match."""
    alpha: Float[Tensor, "h w"]
    cell: int
    xy: Float[Tensor, "n 2"]
    """Cell centres, pixels."""
    z: Float[Tensor, " n"]
    """Depth at the cell centres; 1 where not solid."""
    solid: Bool[Tensor, " n"]
    """One opaque surface fills the cell."""


def _look(
    camera: Camera,
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    cell: int,
    rules: Visibility,
) -> _Seen:
    rows, columns = _grid(depth[None], cell)
    if depth.shape != (camera.height, camera.width):
        raise UsageError(
            f"A depth map has {depth.shape[1]}x{depth.shape[0]} pixels and its camera "
            f"{camera.width}x{camera.height}; resize the camera with Camera.resized."
        )
    depth = depth.double()
    opaque = (alpha > rules.min_alpha) & _drawn(depth)
    solid = opaque.reshape(rows, cell, columns, cell).all(3).all(1)
    solid &= _roughness(torch.where(opaque, 1 / depth, 0.0), cell) <= rules.silhouette
    grid = replace(camera, width=columns, height=rows)
    xy = grid.pixel_centres().reshape(-1, 2) * cell
    z, smooth = _surface(depth, alpha, xy, rules)
    return _Seen(camera, depth, alpha, cell, xy, z, solid.reshape(-1) & smooth)


def _mutual(a: _Seen, b: _Seen, rules: Visibility) -> Pairs:
    there, error_there, good_there = _carry(a, b, rules)
    back, error_back, good_back = _carry(b, a, rules)
    own = torch.arange(len(there))
    error = torch.maximum(error_there, error_back[there])
    mutual = (back[there] == own) & good_there & good_back[there] & (error <= rules.round_trip)
    return Pairs(own[mutual], there[mutual], error[mutual])


def _carry(
    a: _Seen, b: _Seen, rules: Visibility
) -> tuple[Int[Tensor, " n"], Float[Tensor, " n"], Bool[Tensor, " n"]]:
    """For each cell of a: nearest cell of b, displacement from its centre in cells, acceptable."""
    xy, z = b.camera.project(a.camera.unproject(a.xy, a.z))
    xy, inside = _clip(xy, z, b.camera)
    column, row = (xy / b.cell).long().unbind(-1)
    index = row * (b.camera.width // b.cell) + column
    depth, smooth = _surface(b.depth, b.alpha, xy, rules)
    agrees = (z - depth).abs() <= rules.depth_agreement * depth
    scale = (z / _focal(b.camera)) / (a.z / _focal(a.camera))
    alike = (scale <= rules.footprint) & (scale >= 1 / rules.footprint)
    displacement = (xy - b.xy[index]).abs().amax(-1) / b.cell
    good = a.solid & inside & b.solid[index] & smooth & agrees & alike
    return index, displacement, good


def _surface(
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    xy: Float[Tensor, "*p 2"],
    rules: Visibility,
) -> tuple[Float[Tensor, "*p"], Bool[Tensor, "*p"]]:
    """(depth at positions inside the picture, whether the four pixels around show one surface).

    The centre of a cell with an even number of pixels is a pixel corner, so its depth is read
    between four pixels: bilinear in 1 / depth, which is linear across the picture of a plane and so
    exact on one however slanted. Positions where the answer is no get depth 1.
    """
    height, width = depth.shape
    low = (xy - 0.5).floor()
    tx, ty = (xy - 0.5 - low).unbind(-1)
    columns = torch.stack((low[..., 0], low[..., 0] + 1), -1).long().clamp(0, width - 1)
    rows = torch.stack((low[..., 1], low[..., 1] + 1), -1).long().clamp(0, height - 1)
    corner = rows[..., :, None] * width + columns[..., None, :]
    four = depth.reshape(-1)[corner].flatten(-2)
    opaque = (alpha.reshape(-1)[corner].flatten(-2) > rules.min_alpha).all(-1)
    near, far = four.amin(-1), four.amax(-1)
    smooth = opaque & _drawn(near) & _drawn(far) & (far <= (1 + rules.silhouette) * near)
    weights = torch.stack(((1 - ty) * (1 - tx), (1 - ty) * tx, ty * (1 - tx), ty * tx), -1)
    inverse = (weights / torch.where(smooth[..., None], four, 1.0)).sum(-1)
    return 1 / inverse, smooth


def _roughness(inverse: Float[Tensor, "h w"], cell: int) -> Float[Tensor, "y x"]:
    """Spread of 1 / depth in each cell about its least-squares plane, over its mean."""
    height, width = inverse.shape
    blocks = inverse.reshape(height // cell, cell, width // cell, cell).movedim(1, 2)
    x = torch.arange(cell, dtype=inverse.dtype) - (cell - 1) / 2  # orthogonal to 1, and to y
    y, norm = x[:, None], (cell * x.square().sum()).clamp_min(1)
    mean, along_x, along_y = (
        (blocks * basis).sum((2, 3), keepdim=True) / size
        for basis, size in ((torch.ones(()), cell**2), (x, norm), (y, norm))
    )
    rest = blocks - along_x * x - along_y * y
    return (rest.amax((2, 3)) - rest.amin((2, 3))) / mean[..., 0, 0]


def _clip(
    xy: Float[Tensor, "*p 2"], z: Float[Tensor, "*p"], camera: Camera, margin: float = 0.0
) -> tuple[Float[Tensor, "*p 2"], Bool[Tensor, "*p"]]:
    """(positions, the origin instead where outside; in front and `margin` pixels within)."""
    size = xy.new_tensor((camera.width, camera.height))
    low, high = margin - ROUNDING, size - margin + ROUNDING
    inside = (z > 0) & ((xy > low) & (xy < high)).all(-1)  # NaN compares false
    xy = xy.clamp(min=0).minimum(size.nextafter(torch.zeros_like(size)))
    return torch.where(inside[..., None], xy, 0.0), inside


def _drawn(depth: Float[Tensor, "*p"]) -> Bool[Tensor, "*p"]:
    return (depth > 0) & depth.isfinite()


def _focal(camera: Camera) -> float:
    return sqrt(camera.fx * camera.fy)  # one cell's side in the world is proportional to z / focal


def _grid(depths: Float[Tensor, "v h w"], cell: int) -> tuple[int, int]:
    """(rows, columns) of cells."""
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
