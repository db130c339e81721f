"""Fresh discs on the surface of a part: what its views see, fused into one smooth surface.

Each view tells how far points near the surface lie before what it sees or behind it; the mean of
that, smoothed, is 0 on the surface (Curless and Levoy 1996). Needles and noise of a fit go; what
nobody sees gets no disc. `n` Gaussians of the part, `d` discs; world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.formats.mesh import turned_to
from gsedit.scene.framing import ends, weighted_quantile
from gsedit.scene.neighbors import k_nearest
from gsedit.views.dataset import evenly_spaced
from gsedit.views.depth import SeenSurface, seen_surface
from gsedit.views.normals import all_around, visible_area
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

Vectors = Float[Tensor, "d 3"]

CELLS = 224
"""Cells along the longest side of a part: a disc is 1 / CELLS of it."""
VIEWS = 32
"""Most views that are fused."""
MARGIN = 0.06 * CELLS
"""Cells beyond the bulk of a part in which its surface goes on."""
FINER = 2.0
"""Pixels of a view in a cell: colors are finer than the surface."""
PIT = 13
"""Pixels of a hole in depth that is closed."""
CUT = 4.0
"""Distance, in cells, at which distances are cut."""
SOFT = 1.5
"""Standard deviation of the smoothing, cells."""
BAND = 5
"""Cells, across, around what a view sees in which distances are told."""
CLEAR = 0.1
"""Opacity below which a pixel tells that its ray meets nothing."""
BESIDE = 8
"""Gaussians of the part, the nearest, whose mean color a disc has."""
LEAST_VIEWS = 2
"""Views that a cell needs."""
WIDTH, THICKNESS = 0.62, 0.1
"""Standard deviations of a disc, in cells: neighbors overlap, and nothing shines through."""
LOGIT = 5.0
"""Logit of a disc's opacity."""
ABOVE, ASIDE = 2.5, 2.0
"""Largest height over a disc and distance aside, in cells, of the Gaussians that it stands for."""
FINEST, COARSEST = 0.25, 3.0
"""Least and largest cell, in the median standard deviation of the part's Gaussians: finer discs
show nothing more, and of coarser ones detail is lost."""


@dataclass(frozen=True, eq=False)
class Discs:
    """A layer of discs on a part."""

    scene: Gaussians
    """The discs, SH of degree 0: the mean colors of what they lie on."""
    normals: Vectors
    """Unit normals of the discs, outwards."""
    origin: Int[Tensor, " d"]
    """The nearest Gaussian of the part."""
    covered: Bool[Tensor, " n"]
    """The part's Gaussians that the discs stand for: those on the surface and behind it."""
    cell: float
    """Distance of neighboring discs, about."""


@torch.no_grad()
def discs_on(part: Gaussians, cameras: Sequence[Camera] = ()) -> Discs | None:
    """The discs on a part as the cameras see it alone, rings of cameras without any; None where
    there is no surface, or one of finer Gaussians than the discs would be."""
    low, high = ends(part.means, 0.003)
    sizes = part.log_scales.sort(-1).values[:, 1:].mean(-1, keepdim=True)
    usual = float(weighted_quantile(sizes, visible_area(part).to(sizes), 0.5).exp())
    cell = max(float((high - low).amax()) / CELLS, FINEST * usual)
    if cell <= 0 or cell > COARSEST * usual:
        return None
    eyes = list(cameras) or all_around(part)
    views = [_in_cells(eyes[i], part, cell) for i in evenly_spaced(len(eyes), VIEWS)]
    seen = [seen_surface(part, view) for view in views]
    seen = [without_pits(each) for each in seen if bool(each.seen.any())]
    if not seen:
        return None
    low, high = low - MARGIN * cell, high + MARGIN * cell
    grid = _fused(seen, low, high, cell)
    points, normals = _zero(*grid)
    points = low + cell * points
    if not len(points):
        return None
    sizes = torch.tensor((WIDTH, WIDTH, THICKNESS)) * cell
    near = k_nearest(part.means.numpy(), points.numpy(), min(BESIDE, len(part)))[1]
    near = torch.from_numpy(near)
    discs = Gaussians(
        points,
        torch.from_numpy(turned_to(normals.numpy())).to(points),
        sizes.log().expand(len(points), 3).to(points).contiguous(),
        points.new_full((len(points),), LOGIT),
        part.sh[near, :1].mean(1),
    )
    covered = _covered(part.means, points, normals, cell)
    return Discs(discs, normals, near[:, 0], covered, cell)


def _in_cells(camera: Camera, part: Gaussians, cell: float) -> Camera:
    """The camera on pixels of a FINERth of a cell on the part."""
    _, depth = camera.project(part.means)
    near = depth[depth > 0]
    pixel = float(near.median()) / camera.fx if len(near) else cell
    share = min(FINER * pixel / cell, 1024 / camera.longest)
    return camera.resized(*(max(16, round(share * each)) for each in (camera.width, camera.height)))


def without_pits(seen: SeenSurface) -> SeenSurface:
    """The surface without places, narrower than PIT pixels, where depth is behind all around: there
    a view looks through the fit. Near edges stay where they are."""
    from scipy.ndimage import grey_opening

    depth = grey_opening(seen.depth.masked_fill(~seen.seen, torch.inf).numpy(), PIT)
    return replace(seen, depth=torch.from_numpy(depth).masked_fill(~seen.seen, 0.0))


def _fused(
    seen: Sequence[SeenSurface], low: Float[Tensor, "3"], high: Float[Tensor, "3"], cell: float
) -> tuple[Float[Tensor, "x y z"], Bool[Tensor, "x y z"]]:
    """Smoothed signed distances at the middles of cells from `low`, in CUT cells; where known."""
    from scipy.ndimage import gaussian_filter, uniform_filter

    shape = torch.Size(((high - low) / cell).ceil().long().tolist())
    size, touched = torch.tensor(shape), torch.zeros(shape)
    for view in seen:
        at = ((view.points[view.seen].to(low) - low) / cell).floor().long()
        at = at[((at >= 0) & (at < size)).all(-1)]
        touched[tuple(at.T)] = 1.0
    near = torch.from_numpy(uniform_filter(touched.numpy(), BAND)).gt(1e-5).nonzero()
    points = low + (near + 0.5) * cell
    total, count = points.new_zeros(2, len(points))
    for view in seen:
        inside, pixels, z = _pixels(view, points)
        depth = view.depth.to(points).masked_fill(view.alpha < CLEAR, torch.inf)[pixels]
        ahead = (depth - z) / (CUT * cell)
        told = inside & (depth > 0) & (ahead > -1)
        total += torch.where(told, ahead.clamp(-1, 1), 0.0)
        count += told
    known = count >= LEAST_VIEWS
    grids = torch.zeros(2, *shape)
    grids[(slice(None), *near.T)] = torch.stack((total / count.clamp_min(1) * known, known.float()))
    soft = [torch.from_numpy(gaussian_filter(each.numpy(), SOFT)) for each in grids]
    return soft[0] / soft[1].clamp_min(1e-6), grids[1] > 0


def _pixels(
    view: SeenSurface, points: Float[Tensor, "p 3"]
) -> tuple[Bool[Tensor, " p"], tuple[Tensor, Tensor], Float[Tensor, " p"]]:
    """Whether points are in a view's picture, its rows and columns there, and their depths."""
    xy, z, inside = view.camera.pictured(points)
    at = torch.where(inside[:, None], xy, 0).long()
    return inside, (at[:, 1], at[:, 0]), z.to(points)


def _zero(values: Float[Tensor, "x y z"], known: Bool[Tensor, "x y z"]) -> tuple[Vectors, Vectors]:
    """Places between cells at which values are 0, in cells, and the unit slopes there."""
    slope = torch.stack(torch.gradient(values), -1)
    points, normals = [], []
    for axis in range(3):
        count = values.shape[axis] - 1
        before, after = (
            tuple(slice(i, i + count) if each == axis else slice(None) for each in range(3))
            for i in (0, 1)
        )
        a, b = values[before], values[after]
        cut = known[before] & known[after] & (a * b < 0) & ((a - b).abs() < 1)
        share = (a / (a - b))[cut]
        at = cut.nonzero().to(values) + 0.5
        at[:, axis] += share
        points.append(at)
        normals.append(torch.lerp(slope[before][cut], slope[after][cut], share[:, None]))
    return torch.cat(points), torch.nn.functional.normalize(torch.cat(normals), dim=-1)


def _covered(
    means: Float[Tensor, "n 3"], points: Vectors, normals: Vectors, cell: float
) -> Bool[Tensor, " n"]:
    """Whether places lie under the discs, or a little above."""
    _, at = k_nearest(points.numpy(), means.numpy(), 1)
    offset = means - points[at[:, 0]]
    height = (offset * normals[at[:, 0]]).sum(-1)
    aside = (offset.square().sum(-1) - height.square()).clamp_min(0).sqrt()
    return (height < ABOVE * cell) & (aside < ASIDE * cell)
