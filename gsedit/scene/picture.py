"""The picture of a scene at a camera, as files and measures have it."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.render import render
from rasterizer.scene import Gaussians


@torch.no_grad()
def render_picture(
    scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT
) -> Float[Tensor, "h w 3"]:
    """Render the colors over black, clamped to [0, 1], without gradients."""
    return render(scene, camera, numerics=numerics).color.clamp(0, 1)
