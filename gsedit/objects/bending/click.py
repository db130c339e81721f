"""Points of a scene under the pixels of a picture."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians


@torch.no_grad()
def point_at(
    scene: Gaussians, camera: Camera, x: float, y: float, execution: Execution = AUTO
) -> Float[Tensor, "3"]:
    """The point of the surface that a camera sees at a pixel, world units, float64.

    The middle of the top left pixel is at 0.5, 0.5. Raises UsageError outside of the picture, or
    where nothing opaque is seen.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise UsageError(
            f"pixel {x:g},{y:g} is outside of the picture, {camera.width} x {camera.height} pixels"
        )
    box = (int(x), int(y), 1, 1)
    depth = render(scene, camera, crop=box, median_depth=True, execution=execution).median_depth
    assert depth is not None
    if float(depth[0, 0]) <= 0:
        raise UsageError(f"nothing is seen at pixel {x:g},{y:g}: choose one on an object")
    place = torch.tensor((x, y), dtype=torch.float64)
    return camera.unproject(place, depth[0, 0].double())
