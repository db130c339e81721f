"""Surfaces that views see: where a scene's median Gaussians are drawn, with normals and colors.

A Gaussian of a fitted surface lies under it: splats that are widened by a pixel's filter and
blended from the front are drawn too near where they lie on it. The surface that pictures show is
above the centers by a share of the standard deviation along it, the same in scenes of exact discs
and in fits. `n` Gaussians, `h w` pixels; world units.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer.camera import Camera
from rasterizer.project import rotation_matrices
from rasterizer.render import render
from rasterizer.scene import Gaussians

LIFT = 0.55
"""Height of the surface over the center of a Gaussian, in the geometric mean of its two longer
standard deviations: 0.54 where discs are drawn in place, 0.56 and 0.61 in two fits."""
REACH = 0.5
"""Largest distance, in that mean, from the center's depth to where a ray meets its plane: beyond it
the plane of a Gaussian that is hardly flat says nothing."""
FAINT = 1e-30
"""Length of a vector that has no direction."""


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """The surface that a camera sees."""

    camera: Camera
    color: Float[Tensor, "h w 3"]
    """Rendered colors, over black."""
    alpha: Float[Tensor, "h w"]
    depth: Float[Tensor, "h w"]
    """Along the view; 0 where the pixel is less than half opaque."""
    spread: Float[Tensor, "h w"]
    """Mean standard deviation, along the surface, of the Gaussian that is seen; 0 where none is."""

    @property
    def seen(self) -> Bool[Tensor, "h w"]:
        """Whether a pixel shows a surface."""
        return self.depth > 0

    @property
    def points(self) -> Float[Tensor, "h w 3"]:
        """Places of the surface in the world, float64; anything where none is seen."""
        return self.camera.unproject(self.camera.pixel_centers(), self.depth.double())


@torch.no_grad()
def seen_surface(scene: Gaussians, camera: Camera) -> SeenSurface:
    """The surface that a camera sees: where rays meet the planes of the median Gaussians.

    The plane of a Gaussian is where its density is largest along each ray, lifted by LIFT.
    """
    drawn = render(scene, camera, median_depth=True)
    assert drawn.median_row is not None
    found = drawn.median_row >= 0
    rows, inverse = drawn.median_row[found].unique(return_inverse=True)
    centers, normals, spread = _facing_planes(scene[rows], camera)
    lifted = centers + LIFT * spread[:, None] * normals
    rays = _rays(camera, found).to(normals)
    facing = (normals[inverse] * rays).sum(-1)
    near = lifted[inverse, 2]
    met = (normals * lifted).sum(-1)[inverse] / torch.where(facing.abs() > FAINT, facing, -FAINT)
    if camera.model == "ortho":
        met = near  # rays do not meet at the camera: the center's depth
    reach = REACH * spread[inverse]
    depth = torch.minimum(torch.maximum(met, near - reach), near + reach)
    depth = torch.where(depth > 0, depth, centers[inverse, 2])
    empty = torch.zeros_like(drawn.alpha)
    return SeenSurface(
        camera,
        drawn.color,
        drawn.alpha,
        empty.masked_scatter(found, depth),
        empty.masked_scatter(found, spread[inverse]),
    )


def _facing_planes(
    scene: Gaussians, camera: Camera
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"], Float[Tensor, " n"]]:
    """(centers, unit normals towards the camera of where the density along rays is largest, both in
    the camera's axes, and the mean standard deviations along the surface)."""
    pose = camera.world_to_camera.to(scene.means)
    centers = scene.means @ pose[:3, :3].T + pose[:3, 3]
    scales = scene.scales
    longest = scales.amax(-1, keepdim=True)
    shape = torch.maximum(scales / longest.clamp_min(FAINT), scales.new_tensor(0.05))
    axes = pose[:3, :3] @ rotation_matrices(scene.quats)
    towards = centers if camera.model == "pinhole" else centers.new_tensor((0.0, 0.0, 1.0))
    towards = towards.expand_as(centers)
    inner = (axes * towards[:, :, None]).sum(1) / shape.square()
    normals = -torch.nn.functional.normalize((axes * inner[:, None, :]).sum(-1), dim=-1)
    ordered = scales.sort(-1).values
    return centers, normals, (ordered[:, 1] * ordered[:, 2]).sqrt()


def _rays(camera: Camera, found: Bool[Tensor, "h w"]) -> Float[Tensor, "m 3"]:
    """Directions of unit depth, in the camera's axes, through the found pixels."""
    xy = camera.pixel_centers()[found]
    x, y = (xy[:, 0] - camera.cx) / camera.fx, (xy[:, 1] - camera.cy) / camera.fy
    return torch.stack((x, y, torch.ones_like(x)), -1)


@torch.no_grad()
def point_at(scene: Gaussians, camera: Camera, x: float, y: float) -> Float[Tensor, "3"]:
    """The point of the surface that a camera sees at a pixel, world units, float64.

    The middle of the top left pixel is at 0.5, 0.5. Raises UsageError outside of the picture, or
    where nothing opaque is seen.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise UsageError(
            f"pixel {x:g},{y:g} is outside of the picture, {camera.width} x {camera.height} pixels"
        )
    depth = depth_at(scene, camera, x, y)
    if depth <= 0:
        raise UsageError(f"nothing is seen at pixel {x:g},{y:g}: choose one on an object")
    place, far = (torch.tensor(each, dtype=torch.float64) for each in ((x, y), depth))
    return camera.unproject(place, far)


def depth_at(scene: Gaussians, camera: Camera, x: float, y: float) -> float:
    """Median depth at a pixel of the picture; 0 where nothing is."""
    depth = render(scene, camera, crop=(int(x), int(y), 1, 1), median_depth=True).median_depth
    assert depth is not None  # it was asked for
    return float(depth)
