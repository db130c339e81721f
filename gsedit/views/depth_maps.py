"""When a rendered depth map shows one surface, how far away it is, and a picture seen through it.

`h w` pixels, `y x` cells of `cell` pixels, `p` positions. xy is in pixels, the corner of the first
pixel at (0, 0). Depth is along the view, 0 where nothing was rendered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from rasterizer.camera import Camera


@dataclass(frozen=True)
class Visibility:
    """When two cells are believed to show the same surface. Each rule stops one kind of error."""

    min_alpha: float = 0.9
    """Opacity a pixel needs: below it the depth is a blend of surfaces that are not there."""
    depth_agreement: float = 0.01
    """Largest |z - depth_b| / depth_b: beyond it something else stands in front (occlusion)."""
    round_trip: float = 0.5
    """Largest distance, in cells, from a cell's center to where it returns: carried to the other
    view by its own depth, and back by the other's. The same error of depth matters more the
    farther apart the cameras are, and this is what it amounts to in the picture."""
    silhouette: float = 0.05
    """Largest relative spread of 1 / depth in a cell about its best plane (a step keeps its whole
    height, a slope has none), and of depth between neighbors: beyond it there are two surfaces."""
    footprint: float = 2.0
    """Largest stretch of a cell, either way and along any direction, from the one picture to the
    other, by distance and by the surface's slant: beyond it one cell holds several of the other,
    and one value cannot stand for all."""
    angle: float = 60.0
    """Degrees, the largest angle between the two lines of sight at the surface: beyond it captured
    surfaces look different (shine, relief that hides parts of itself), and depth is less exact."""


DEFAULT_RULES = Visibility()
ROUNDING = 1e-6
"""Pixels: a position on the border of a picture is inside it, whatever float64 makes of it."""


def surface_at(
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    xy: Float[Tensor, "*p 2"],
    rules: Visibility,
) -> tuple[Float[Tensor, "*p"], Bool[Tensor, "*p"]]:
    """(depth at positions inside the picture, whether the four pixels around show one surface).

    The center of a cell with an even number of pixels is a pixel corner, so its depth is read
    between four pixels: bilinear in 1 / depth, which is linear across the picture of a plane and so
    exact on one however slanted. Elsewhere depth is 1.
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
    smooth = opaque & has_depth(near) & has_depth(far) & (far <= (1 + rules.silhouette) * near)
    weights = torch.stack(((1 - ty) * (1 - tx), (1 - ty) * tx, ty * (1 - tx), ty * tx), -1)
    inverse = (weights / torch.where(smooth[..., None], four, 1.0)).sum(-1)
    return 1 / inverse, smooth


def fit_planes(
    inverse: Float[Tensor, "h w"], cell: int
) -> tuple[Float[Tensor, "y x 2"], Float[Tensor, "y x"]]:
    """The least-squares plane of 1 / depth in each cell: (its slope along x and y, a pixel; the
    spread of 1 / depth about it, over the mean)."""
    height, width = inverse.shape
    blocks = inverse.reshape(height // cell, cell, width // cell, cell).movedim(1, 2)
    x = torch.arange(cell, dtype=inverse.dtype) - (cell - 1) / 2  # orthogonal to 1, and to y
    y, norm = x[:, None], (cell * x.square().sum()).clamp_min(1)
    mean, along_x, along_y = (
        (blocks * basis).sum((2, 3), keepdim=True) / size
        for basis, size in ((torch.ones(()), cell**2), (x, norm), (y, norm))
    )
    rest = blocks - along_x * x - along_y * y
    slope = torch.cat((along_x, along_y), 2)[..., 0]
    return slope, (rest.amax((2, 3)) - rest.amin((2, 3))) / mean[..., 0, 0]


def clip_to_picture(
    xy: Float[Tensor, "*p 2"], z: Float[Tensor, "*p"], camera: Camera, margin: float = 0.0
) -> tuple[Float[Tensor, "*p 2"], Bool[Tensor, "*p"]]:
    """(positions, the origin where outside; which are in front and `margin` pixels within)."""
    size = xy.new_tensor((camera.width, camera.height))
    low, high = margin - ROUNDING, size - margin + ROUNDING
    inside = (z > 0) & ((xy > low) & (xy < high)).all(-1)  # NaN compares false
    xy = xy.clamp(min=0).minimum(size.nextafter(torch.zeros_like(size)))
    return torch.where(inside[..., None], xy, 0.0), inside


def has_depth(depth: Float[Tensor, "*p"]) -> Bool[Tensor, "*p"]:
    """Flag pixels where something was rendered: depth is 0 elsewhere."""
    return (depth > 0) & depth.isfinite()


class Warp(NamedTuple):
    """Warp from view a to view b: the position of each pixel's surface in b."""

    places: Float[Tensor, "h w 2"]
    """In b's picture from -1 to 1, the corners of its corner pixels."""
    valid: Bool[Tensor, "h w"]

    def __call__(self, image_b: Float[Tensor, "h2 w2 k"]) -> Float[Tensor, "h w k"]:
        """b's picture as seen from a, bilinear; differentiable in it; 0 where invalid."""
        warped = F.grid_sample(
            image_b.permute(2, 0, 1)[None],
            self.places[None].to(image_b),
            padding_mode="border",
            align_corners=False,
        )
        return warped[0].permute(1, 2, 0) * self.valid[..., None]


@torch.no_grad()
def warp_of(
    camera_a: Camera,
    depth_a: Float[Tensor, "h w"],
    alpha_a: Float[Tensor, "h w"],
    camera_b: Camera,
    depth_b: Float[Tensor, "h2 w2"],
    alpha_b: Float[Tensor, "h2 w2"],
    rules: Visibility = DEFAULT_RULES,
) -> Warp:
    """From view b to view a, through a's depth.

    Valid: both views opaque, no silhouette under the sample, depths agree, and b's depth carries
    the point back to within one pixel of its start.
    """
    depth_a, depth_b = depth_a.double(), depth_b.double()
    centers = camera_a.pixel_centers()
    solid = (alpha_a > rules.min_alpha) & has_depth(depth_a)
    start = torch.where(solid, depth_a, 1.0)
    xy, z = camera_b.project(camera_a.unproject(centers, start))
    xy, inside = clip_to_picture(xy, z, camera_b, margin=0.5)  # between pixel centers
    there, opaque = surface_at(depth_b, alpha_b, xy, rules)
    back, _ = camera_a.project(camera_b.unproject(xy, there))
    returns = (back - centers).abs().amax(-1) < 1
    agrees = (z - there).abs() <= rules.depth_agreement * there
    size = xy.new_tensor((camera_b.width, camera_b.height))
    return Warp(2 * xy / size - 1, solid & inside & opaque & agrees & returns)
