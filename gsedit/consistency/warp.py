"""A picture seen through another view, by depth."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.consistency.depth_maps import (
    DEFAULT_RULES,
    Visibility,
    clip_to_picture,
    has_depth,
    surface_at,
)
from rasterizer.camera import Camera


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
    """View b's picture as seen from a, and where that is valid; see `Warp` and `warp_of`."""
    found = warp_of(camera_a, depth_a, alpha_a, camera_b, depth_b, alpha_b, rules)
    return found(image_b), found.valid
