"""EWA projection: each 3D Gaussian to a 2D one on the picture plane. `n` Gaussians, xy in pixels.

The 2D covariance M M^T + blur I, with M = J R_camera R S (2 x 3), is never inverted: its Cholesky
factor is, and the
determinant is summed from squares (Lagrange's identity |m1|^2 |m2|^2 - (m1 m2)^2 = |m1 x m2|^2),
so that nothing
cancels on a needle.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import Numerics
from rasterizer.scene import Gaussians

Box = tuple[int, int, int, int]
"""A rectangle of pixels: left, top, width, height."""


@dataclass(frozen=True, eq=False)
class Projected:
    """2D Gaussians: alpha at xy + d is opacity exp(-|W d|^2 / 2), W = [[w0, 0], [w1, w2]]."""

    xy: Float[Tensor, "n 2"]
    whitening: Float[Tensor, "n 3"]
    """w0, w1, w2: the inverse of the covariance's lower Cholesky factor, 1/pixels."""
    depth: Float[Tensor, " n"]
    """Of the centre, along the view."""
    order: Float[Tensor, " n"]
    """The same in float64, to sort by: float32 puts two of 10,000 in the wrong order, and a pixel
    then jumps. Without gradients."""
    covariance: Float[Tensor, "n 4"]
    """xx, xy, yy and the determinant; for choosing tiles only, without gradients."""


def rotation_matrices(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotations of wxyz quaternions of any norm; the zero quaternion is the identity."""
    squared = (quats * quats).sum(-1, keepdim=True)
    degenerate = squared == 0
    w, x, y, z = (quats * squared.masked_fill(degenerate, 1).rsqrt()).unbind(-1)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(rows, -1).unflatten(-1, (3, 3))


def slope_limits(camera: Camera, numerics: Numerics) -> tuple[float, float, float, float]:
    """Bounds of x/z and y/z at which the Jacobian is taken: the picture plus a margin (gsplat)."""
    mx, my = numerics.margin * camera.width / 2, numerics.margin * camera.height / 2
    return (
        (-camera.cx - mx) / camera.fx,
        (camera.width - camera.cx + mx) / camera.fx,
        (-camera.cy - my) / camera.fy,
        (camera.height - camera.cy + my) / camera.fy,
    )


@torch.no_grad()
def visible(scene: Gaussians, camera: Camera, box: Box, numerics: Numerics) -> Int[Tensor, " m"]:
    """Rows that may touch the box: in front of the near plane, not transparent, near enough to it.

    The test bounds each footprint by the sphere of its largest axis, so it never drops what is
    seen.
    """
    pose = camera.world_to_camera.detach().to(scene.means)
    x, y, z = (scene.means @ pose[:3, :3].T + pose[:3, 3]).unbind(-1)
    keep = (z > numerics.near) & (scene.opacities >= numerics.alpha_min)
    safe_z = z.clamp_min(numerics.near)
    low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
    sigma = scene.log_scales.amax(-1).exp() / safe_z
    cut_off = (2 * (scene.opacities / numerics.alpha_min).log().clamp_min(0)).sqrt()
    left, top, width, height = box
    for at, focal, centre, low, high, start, size in (
        (x, camera.fx, camera.cx, low_x, high_x, left, width),
        (y, camera.fy, camera.cy, low_y, high_y, top, height),
    ):
        slope = at / safe_z
        stretch = (1 + slope.clamp(low, high).square()).sqrt() * focal
        reach = (
            cut_off * ((sigma * stretch).square() + numerics.blur).sqrt() * 1.001 + 1
        )  # rounding
        offset = slope * focal + (centre - start)
        keep &= (offset > -reach) & (offset < size + reach)
    return keep.nonzero().squeeze(-1)


def project(scene: Gaussians, camera: Camera, numerics: Numerics) -> Projected:
    """Project Gaussians that lie in front of the camera; differentiable in scene and pose."""
    pose = camera.world_to_camera.to(scene.means)
    x, y, z = (scene.means @ pose[:3, :3].T + pose[:3, 3]).unbind(-1)
    slope_x, slope_y = x / z, y / z
    pose64 = camera.world_to_camera.detach().double()
    low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
    jx, jy = slope_x.clamp(low_x, high_x), slope_y.clamp(low_y, high_y)
    axes = pose[:3, :3] @ (rotation_matrices(scene.quats) * scene.scales[:, None, :])
    m1 = (camera.fx / z)[:, None] * (axes[:, 0] - jx[:, None] * axes[:, 2])
    m2 = (camera.fy / z)[:, None] * (axes[:, 1] - jy[:, None] * axes[:, 2])
    s1, s2, cross = m1.square().sum(-1), m2.square().sum(-1), torch.linalg.cross(m1, m2)
    xx, xy, yy = s1 + numerics.blur, (m1 * m2).sum(-1), s2 + numerics.blur
    determinant = cross.square().sum(-1) + numerics.blur * (s1 + s2) + numerics.blur**2
    w2 = (xx / determinant).sqrt()
    return Projected(
        xy=torch.stack((camera.fx * slope_x + camera.cx, camera.fy * slope_y + camera.cy), -1),
        whitening=torch.stack((xx.rsqrt(), -xy / xx * w2, w2), -1),
        depth=z,
        order=scene.means.detach().double() @ pose64[2, :3] + pose64[2, 3],
        covariance=torch.stack((xx, xy, yy, determinant), -1).detach(),
    )
