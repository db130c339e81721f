"""A camera: OpenCV axes (x right, y down, z forward), pixel centers at +0.5."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians, tan
from typing import Any, Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose, intrinsics and size of a picture."""

    world_to_camera: Float[Tensor, "4 4"]
    """Rigid transform; may require gradients. Usually float64; cast to the scene's dtype."""
    fx: float
    """Focal lengths and principal point, pixels; the corner of the first pixel is (0, 0)."""
    fy: float
    cx: float
    cy: float
    width: int
    """Picture width, pixels; its height is below."""
    height: int
    model: Literal["pinhole", "ortho"] = "pinhole"
    """ortho: parallel rays. The pixel's x is fx x + cx at any depth; fx is pixels per world
    unit."""
    near: float | None = None
    """Splats are drawn whose center is farther than this, world units; None: `Numerics.near`. A
    camera that is made for a scene knows how small its units are."""

    @property
    def rotation(self) -> Float[Tensor, "3 3"]:
        return self.world_to_camera[:3, :3]

    @property
    def center(self) -> Float[Tensor, "3"]:
        """The camera's position in the world."""
        return -self.rotation.T @ self.world_to_camera[:3, 3]

    @property
    def forward(self) -> Float[Tensor, "3"]:
        """The viewing direction in the world, unit length."""
        return self.world_to_camera[2, :3]

    @property
    def longest(self) -> int:
        """Pixels of the longer side."""
        return max(self.width, self.height)

    def resized(self, width: int, height: int) -> Camera:
        """View from here on another pixel grid."""
        x, y = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * x,
            cx=self.cx * x,
            fy=self.fy * y,
            cy=self.cy * y,
            width=width,
            height=height,
        )

    def fitted(self, size: int) -> Camera:
        """View from here with `size` pixels on its longer side; no larger than it is."""
        return self.scaled(min(1.0, size / self.longest))

    def scaled(self, factor: float) -> Camera:
        """View from here on so many times the pixels a side."""
        return self.resized(*(max(1, round(side * factor)) for side in (self.width, self.height)))

    def project(
        self, points: Float[Tensor, "*b 3"]
    ) -> tuple[Float[Tensor, "*b 2"], Float[Tensor, "*b"]]:
        """Pixel positions and depth along the view (which may be negative: behind)."""
        pose = self.world_to_camera.to(points)
        x, y, z = (points @ pose[:3, :3].T + pose[:3, 3]).unbind(-1)
        scale = z if self.model == "pinhole" else 1
        return torch.stack((self.fx * x / scale + self.cx, self.fy * y / scale + self.cy), -1), z

    def pictured(
        self, points: Float[Tensor, "*b 3"], margin: float = 0.0
    ) -> tuple[Float[Tensor, "*b 2"], Float[Tensor, "*b"], Bool[Tensor, "*b"]]:
        """`project`, and which points are in front and in the picture, a share of its sides in."""
        xy, z = self.project(points)
        size = xy.new_tensor((self.width, self.height))
        inside = ((xy >= margin * size) & (xy < (1 - margin) * size)).all(-1)
        return xy, z, inside & (z > 0)

    def unproject(
        self, xy: Float[Tensor, "*b 2"], depth: Float[Tensor, "*b"]
    ) -> Float[Tensor, "*b 3"]:
        """World points at a depth along the view behind pixel positions: the inverse of project."""
        pose = self.world_to_camera.to(xy)
        scale = depth if self.model == "pinhole" else 1
        x = (xy[..., 0] - self.cx) / self.fx * scale
        y = (xy[..., 1] - self.cy) / self.fy * scale
        return (torch.stack((x, y, depth), -1) - pose[:3, 3]) @ pose[:3, :3]

    def pixel_centers(self) -> Float[Tensor, "h w 2"]:
        """Positions of all pixel centers, float64."""
        y, x = torch.meshgrid(
            torch.arange(self.height, dtype=torch.float64) + 0.5,
            torch.arange(self.width, dtype=torch.float64) + 0.5,
            indexing="ij",
        )
        return torch.stack((x, y), -1)


def look_at(
    eye: Float[Tensor, "3"],
    target: Float[Tensor, "3"],
    up: Float[Tensor, "3"],
    fov_y: float,
    width: int,
    height: int,
) -> Camera:
    """A camera at `eye` that looks at `target`; `fov_y` in degrees; `up` not along the view."""
    eye, target, up = (v.to(torch.float64) for v in (eye, target, up))
    forward = torch.nn.functional.normalize(target - eye, dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, up), dim=0)
    pose = pose_of(torch.stack((right, torch.linalg.cross(forward, right), forward)), eye)
    focal = height / 2 / tan(radians(fov_y) / 2)
    return Camera(pose, focal, focal, width / 2, height / 2, width, height)


def pose_of(rotation: Any, center: Any) -> Float[Tensor, "4 4"]:
    """World to camera, float64, of a camera at a center with these axes as rows (right, down and
    forward): arrays or tensors."""
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.as_tensor(rotation)
    pose[:3, 3] = -pose[:3, :3] @ torch.as_tensor(center).to(pose)
    return pose
