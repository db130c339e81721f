"""Layers on a relief: their thickness, round at the edges, and the Gaussians they are made of.

`h w` pixels, `m` Gaussians; world units, float64.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.objects.growth.spots import Site, Spots
from gsedit.surface.relief import Relief, without_specks
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians

ROUND = 0.9
"""Width of the round edge, in the thickness."""
SWELL, SWELL_WIDTH = 0.35, 6.0
"""Share of the thickness that is in the middle only, and the distance from the edge, in the
thickness, over which it comes."""
SPREAD, FLAT = 0.72, 0.16
"""Standard deviations along and across a surface, in pixels: neighbors blend to an even one."""
STEEPEST = 0.2
"""Cosine below which a disc is not stretched any more."""
MOST_OPAQUE = 0.985


@dataclass(frozen=True, eq=False)
class Patch:
    """A layer that lies on a relief."""

    site: Site
    relief: Relief
    """The surface under it, smooth."""
    lies: Bool[Tensor, "h w"]
    height: Float[Tensor, "h w"]
    """Thickness over the surface; 0 where it does not lie."""
    share: Float[Tensor, "h w"]
    """How much of each pixel it covers, in [0, 1]."""

    @property
    def top(self) -> Relief:
        """The layer's own surface."""
        top = self.relief.at(self.relief.heights + self.height)
        return replace(top, there=self.lies)

    def spots(self, surface: Relief) -> Spots:
        """Places of the layer, one a pixel, on its top or on the relief under it."""
        normals = surface.normals()[self.lies]
        return self.site.spots(surface.points[self.lies], normals)


def covered(relief: Relief, share: Float[Tensor, "h w"], least: float) -> Bool[Tensor, "h w"]:
    """Pixels that a layer lies on: those that more than the least share covers, without specks and
    small holes."""
    lies = without_specks((share > least) & relief.there)
    return ~without_specks(~lies) & relief.there


def thickness(relief: Relief, lies: Bool[Tensor, "h w"], most: float) -> Float[Tensor, "h w"]:
    """Height of a layer over the surface: round at its edges, `most` far from them."""
    from scipy import ndimage

    edges = relief.brinks(most) | ~lies
    away = torch.from_numpy(ndimage.distance_transform_edt(~edges.numpy())) * relief.pixel
    rim = (away / (ROUND * most)).clamp(0, 1)
    middle = (away / (SWELL_WIDTH * most)).clamp(0, 1)
    profile = (1 - (1 - rim).square()).sqrt() * (1 - SWELL + SWELL * middle * (2 - middle))
    return most * profile * lies


def discs(
    points: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    relief: Relief,
    opacity: Float[Tensor, " m"] | float,
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Flat Gaussians along a surface that is sampled once a pixel along the relief's axis,
    stretched where it is steep; display colors."""
    cosine = (normals @ relief.axis).clamp_min(STEEPEST)
    downhill = relief.axis - (normals @ relief.axis)[:, None] * normals
    along = torch.where(
        downhill.norm(dim=-1, keepdim=True) < 1e-3, perpendicular(normals), downhill
    )
    wide = torch.full_like(cosine, SPREAD)
    scales = torch.stack((wide / cosine, wide, torch.full_like(cosine, FLAT)), -1)
    return assembled(points, along, normals, relief.pixel * scales, opacity, colors)


def assembled(
    points: Float[Tensor, "m 3"],
    along: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    scales: Float[Tensor, "m 3"],
    opacity: Float[Tensor, " m"] | float,
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Gaussians of SH degree 0 with their last axis along unit normals and their first as near to
    another vector as that leaves; float32."""
    first = along - (along * normals).sum(-1, keepdim=True) * normals
    first = torch.nn.functional.normalize(first, dim=-1)
    frames = torch.stack((first, torch.linalg.cross(normals, first), normals), -1)
    opacities = torch.as_tensor(opacity, dtype=torch.float64).expand(len(points))
    found = Gaussians(
        points, _quaternions(frames), scales.clamp_min(1e-12).log(),
        torch.logit(opacities.clamp(1e-4, MOST_OPAQUE)), color_to_sh(colors)[:, None],
    )  # fmt: skip
    return found.to(torch.float32)


def _quaternions(frames: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 4"]:
    """Quaternions wxyz of rotation matrices."""
    from scipy.spatial.transform import Rotation

    if not len(frames):
        return frames.new_zeros(0, 4)
    return torch.from_numpy(Rotation.from_matrix(frames.numpy()).as_quat()[:, [3, 0, 1, 2]])
