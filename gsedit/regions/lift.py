"""From values in pictures to values of Gaussians: the mean over all views, by blending weight.

A picture is linear in the colors of the Gaussians, and the factor of a Gaussian's color in a
pixel is its blending weight. The transpose of that map gives the sum of a map's values, weighted by
what each Gaussian contributes to each pixel.

`n` Gaussians; maps of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

CENTRAL_SIGMA_SIDES = 0.25
"""Standard deviation of the window over the middle of a picture, of its shorter side."""


@dataclass(frozen=True, eq=False)
class Lifted:
    """Values of pictures, lifted to each Gaussian."""

    mean: Float[Tensor, " n"]
    """Mean of the maps' values, weighted by the Gaussian's contributions; 0 in no view."""
    weight: Float[Tensor, " n"]
    """Contribution of the Gaussian to all views, pixels."""
    central: Float[Tensor, " n"]
    """Contribution under a window over the middle of each view: what the cameras look at."""


def lift(
    scene: Gaussians,
    cameras: Sequence[Camera],
    maps: Sequence[Float[Tensor, "h w"]],
    execution: Execution = AUTO,
) -> Lifted:
    """Means over all views of maps with one value a pixel; a map has its camera's size."""
    sums = scene.means.new_zeros(len(scene), 3)
    for camera, values in zip(cameras, maps, strict=True):
        ones = torch.ones_like(values)
        stacked = torch.stack((values, ones, _middle(camera).to(values)), -1)
        sums += color_weights(scene, camera, execution=execution).back(stacked.to(sums))
    total, weight, central = sums.unbind(-1)
    return Lifted(total / weight.clamp_min(1e-9), weight, central)


SILHOUETTE = 0.5
"""Share of a pixel that the inside gives, from which the pixel is in its silhouette; and share of a
Gaussian's pixels that must be in it."""


@torch.no_grad()
def within_silhouette(
    scene: Gaussians,
    cameras: Sequence[Camera],
    inside: Bool[Tensor, " n"],
    execution: Execution = AUTO,
) -> Bool[Tensor, " n"]:
    """The Gaussians inside without those that are seen mostly beyond the silhouette of all.

    These are wide or stray ones, whose color would show far outside. What no view shows stays.
    """
    colors = inside.to(scene.means)[:, None].expand(-1, 3).contiguous()
    sums = scene.means.new_zeros(len(scene), 3)
    for camera in cameras:
        weights = color_weights(scene, camera, execution=execution)
        shown = (weights.picture(colors)[..., :1] > SILHOUETTE).to(sums)
        sums += weights.back(torch.cat((shown, torch.ones_like(shown), shown), -1))
    return inside & (sums[:, 0] >= SILHOUETTE * sums[:, 1])


def _middle(camera: Camera) -> Float[Tensor, "h w"]:
    """A Gaussian window, 1 in the middle of the picture."""
    middle = torch.tensor((camera.width, camera.height)) / 2
    side = min(camera.width, camera.height)
    square = ((camera.pixel_centers() - middle) / (CENTRAL_SIGMA_SIDES * side)).square().sum(-1)
    return torch.exp(-square / 2)
