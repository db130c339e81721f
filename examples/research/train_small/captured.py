"""Photos of a capture with depth, normals and the subject's mask: to evaluate editors on.

`n` photos of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.datasets.dataset import View
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians
from research.train_small.sources import FAR, Sources, cat

SOLID = 0.5  # alpha; below it a pixel is sky


@dataclass(frozen=True, eq=False)
class UprightCylinder:
    """Subject of a capture: above a level and within a distance of an upright axis."""

    center: Float[Tensor, "3"]
    up: Float[Tensor, "3"]
    """Up direction, a unit vector."""
    radius: float
    """Radius in world units."""
    lowest: float
    """Along `up` from the center, world units."""

    def contains(self, points: Float[Tensor, "*b 3"]) -> Bool[Tensor, "*b"]:
        """Whether points are inside."""
        offset = points - self.center.to(points)
        height = offset @ self.up.to(points)
        radius = (offset - height[..., None] * self.up.to(points)).norm(dim=-1)
        return (height > self.lowest) & (radius < self.radius)


def captured(scene: Gaussians, views: Sequence[View], subject: UprightCylinder) -> Sources:
    """The photos, with the geometry of a scene that was fitted to them."""
    return cat([_with_geometry(scene, view, subject) for view in views])


def focus_point(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The point nearest to the cameras' optical axes, least squares."""
    axes = torch.stack([camera.world_to_camera[2, :3] for camera in cameras]).double()
    centers = torch.stack([camera.center for camera in cameras]).double()
    across = torch.eye(3, dtype=torch.float64) - axes[:, :, None] * axes[:, None]
    return torch.linalg.solve(across.sum(0), (across @ centers[..., None]).sum(0))[:, 0]


def mean_up(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The upright axis of photos that were taken all around, none of them tilted sideways."""
    downward = torch.stack([camera.world_to_camera[1, :3] for camera in cameras]).double()
    return F.normalize(-downward.mean(0), dim=0)


@torch.no_grad()
def _with_geometry(scene: Gaussians, view: View, subject: UprightCylinder) -> Sources:
    camera = view.camera
    rendered = render(scene, camera, median_depth=True)
    assert rendered.median_depth is not None
    depth, solid = rendered.median_depth.double(), rendered.alpha > SOLID
    pixels = camera.pixel_centers().reshape(-1, 2)
    points = camera.unproject(pixels, depth.reshape(-1)).double().reshape(*depth.shape, 3)
    mask = subject.contains(points) & solid
    near = depth[mask].median() if mask.any() else depth[solid].median()
    normal = _normals(points, camera.center.double()) @ _upright(subject.up.double()).T
    at_sky = F.max_pool2d((~solid)[None].float(), 3, 1, 1)[0] > 0  # no depth to differentiate
    return Sources(
        image=view.image[None].float(),
        depth=(depth / near).masked_fill(~solid, FAR).clamp(max=FAR)[None, ..., None].float(),
        normal=(normal * ~at_sky[..., None])[None].float(),
        subject=mask[None, ..., None].float(),
    )


def _normals(points: Float[Tensor, "h w 3"], center: Float[Tensor, "3"]) -> Float[Tensor, "h w 3"]:
    """Unit normals of unprojected pixels from central differences, toward the camera's center."""
    padded = F.pad(points.movedim(-1, 0)[None], (1, 1, 1, 1), mode="replicate")[0].movedim(0, -1)
    across, down = padded[1:-1, 2:] - padded[1:-1, :-2], padded[2:, 1:-1] - padded[:-2, 1:-1]
    normal = F.normalize(torch.linalg.cross(across, down), dim=-1)
    away = ((points - center) * normal).sum(-1, keepdim=True) > 0
    return torch.where(away, -normal, normal)


def _upright(up: Float[Tensor, "3"]) -> Float[Tensor, "3 3"]:
    """A rotation that takes `up` to +z."""
    across = -perpendicular(up)
    return torch.stack((across, torch.linalg.cross(up, across), up))
