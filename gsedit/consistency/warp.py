"""A picture seen through another view, by depth."""

from __future__ import annotations

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
        solid = (alpha_a > rules.min_alpha) & has_depth(depth_a)
        start = torch.where(solid, depth_a, 1.0)
        xy, z = camera_b.project(camera_a.unproject(centres, start))
        xy, inside = clip_to_picture(xy, z, camera_b, margin=0.5)  # between pixel centres
        there, opaque = surface_at(depth_b, alpha_b, xy, rules)
        back, _ = camera_a.project(camera_b.unproject(xy, there))
        returns = (back - centres).abs().amax(-1) < 1
        agrees = (z - there).abs() <= rules.depth_agreement * there
        valid = solid & inside & opaque & agrees & returns
        size = xy.new_tensor((camera_b.width, camera_b.height))
        sample = (2 * xy / size - 1)[None].to(image_b)  # align_corners=False: corners at -1 and 1
    warped = F.grid_sample(
        image_b.permute(2, 0, 1)[None], sample, padding_mode="border", align_corners=False
    )
    return warped[0].permute(1, 2, 0) * valid[..., None], valid
