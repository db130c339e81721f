"""Cameras as pyramids of lines, and a camera that shows them with their scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from gsedit.datasets.viewpoints import Viewpoint
from gsedit.scene.framing import bounds, framing_camera
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

SHARE = 0.06
"""Length of a pyramid in the extent of the cameras, or of the scene where there is one camera."""
EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
"""Edges of a pyramid: its tip is corner 0, the corners of its picture are 1 to 4."""


def frustum_length(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> float:
    """The length of the pyramids along their views, world units."""
    centers = torch.stack([v.camera.center.detach() for v in viewpoints])
    extent = float((centers - centers.mean(0)).norm(dim=1).max())
    return SHARE * (extent or bounds(scene).radius)


def frustum(camera: Camera, length: float) -> Float[np.ndarray, "5 3"]:
    """The camera's center and the corners of its picture at `length` along the view, in the
    world."""
    w, h = camera.width, camera.height
    corners = torch.tensor([[0, 0], [w, 0], [w, h], [0, h]], dtype=torch.float64)
    depth = torch.full((4,), length, dtype=torch.float64)
    far = camera.unproject(corners, depth).detach()
    return torch.cat((camera.center.detach().double()[None], far)).numpy()


def upward(viewpoints: Sequence[Viewpoint]) -> Float[torch.Tensor, "3"]:
    """The mean upward direction of the cameras, as people hold them; unit length, float64."""
    ups = torch.stack([-v.camera.rotation[1].detach().double() for v in viewpoints])
    return torch.nn.functional.normalize(ups.mean(0), dim=0)


def outside_camera(
    scene: Gaussians, viewpoints: Sequence[Viewpoint], size: tuple[int, int]
) -> Camera:
    """A camera that shows the bulk of the scene and all cameras, from above; `size` is (width,
    height)."""
    up = upward(viewpoints)
    centers = torch.stack([v.camera.center.detach().double() for v in viewpoints])
    first = framing_camera(scene, up=up, size=size)
    middle = torch.tensor(bounds(scene).center, dtype=torch.float64)
    direction = first.center - middle
    direction = direction + 0.4 * direction.norm() * up  # a ring of cameras is seen from above it
    for step in range(40):  # 1.1^40 = 45 times as far
        camera = framing_camera(
            scene, up=up, eye=middle + direction * 1.1**step, target=middle, size=size
        )
        xy, depth = camera.project(centers)
        inside = (xy >= 0) & (xy <= torch.tensor(size))
        if bool(inside.all()) and bool((depth > 0).all()):
            return camera
    return first
