"""EWA projection: each 3D Gaussian to a 2D one on the picture plane. `n` Gaussians, xy in pixels.

The 2D covariance M M^T + blur I, with M = J R_camera R S (2 x 3), is never inverted: its Cholesky
factor is, and the variance of y at a given x is summed from squares (Lagrange's identity
|m1|^2 |m2|^2 - (m1 m2)^2 = |m1 x m2|^2), so that nothing cancels on a needle. Centers are moved to
the camera in float64: 1e7 from the origin, float32 would lose what is left of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import harmonics
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
    """Depth of the center along the view, world units."""
    sort_depth: Float[Tensor, " n"]
    """Depth in float64, to sort by: float32 puts two of 10,000 in the wrong order,
    and a pixel then jumps. Without gradients."""
    covariance: Float[Tensor, "n 4"]
    """xx, xy, yy, and the variance of x at a given y; for choosing tiles only, without
    gradients."""
    log_compensation: Float[Tensor, " n"] | None = None
    """Natural logarithm of the factor by which antialiasing changes each opacity; None: it is
    off."""


def rotation_matrices(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotations of wxyz quaternions of any norm; the zero quaternion is the identity.

    Gradients grow as 1 / norm. They are zero for the zero quaternion, and where they would
    overflow: below a norm of about 1e-31 in float32, 1e-292 in float64.
    """
    quats = quats.T.contiguous()  # rows of n numbers: steps over them are long ones
    largest = quats.detach().abs().amax(0)
    limits = torch.finfo(quats.dtype)
    tiny = largest < limits.smallest_normal / limits.eps
    # by the largest first: neither 1e-30 nor 1e30 has a square in float32
    held = quats.detach() / largest.masked_fill(largest == 0, 1)
    scaled = torch.where(tiny, held, quats / largest.masked_fill(tiny, 1))
    squared = (scaled * scaled).sum(0).masked_fill(largest == 0, 1)
    w, x, y, z = (scaled * squared.rsqrt()).unbind()
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(rows).T.unflatten(-1, (3, 3))


def near_plane(camera: Camera, numerics: Numerics) -> float:
    """Distance of the near plane, world units: the camera's own, or else that of the settings."""
    return numerics.near if camera.near is None else camera.near


def slope_limits(camera: Camera, numerics: Numerics) -> tuple[float, float, float, float]:
    """Bounds (low x, high x, low y, high y) of x/z and y/z at which the Jacobian is taken: the
    picture plus a margin, as gsplat has it."""
    mx, my = numerics.margin * camera.width / 2, numerics.margin * camera.height / 2
    return (
        (-camera.cx - mx) / camera.fx,
        (camera.width - camera.cx + mx) / camera.fx,
        (-camera.cy - my) / camera.fy,
        (camera.height - camera.cy + my) / camera.fy,
    )


@torch.no_grad()
def cull(
    means: Float[Tensor, "n 3"],
    extents: Float[Tensor, " n"],
    opacities: Float[Tensor, " n"],
    camera: Camera,
    box: Box,
    numerics: Numerics,
) -> Int[Tensor, " m"]:
    """Rows that may touch the box: between the planes, not transparent, near enough to it.

    Each Gaussian is bounded by a sphere of `extents`, its largest standard deviation in world
    units, so none that contributes is dropped. `opacities` are in [0, 1]. The rows ascend.
    Raises ValueError for a near plane behind a pinhole.
    """
    near = near_plane(camera, numerics)
    if camera.model == "pinhole" and near < 0:
        raise ValueError(f"near is {near}: below 0 only for an orthographic camera")
    centers = _in_camera(means, camera)
    keep = (centers[2] > near) & (centers[2] <= numerics.far)
    keep &= opacities >= numerics.alpha_min
    x, y, z = centers.to(means)
    distance = z.clamp_min(near) if camera.model == "pinhole" else torch.ones_like(z)
    low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
    sigma = extents / distance
    cutoff = (2 * (opacities / numerics.alpha_min).log().clamp_min(0)).sqrt()
    left, top, width, height = box
    for at, focal, center, low, high, start, size in (
        (x, camera.fx, camera.cx, low_x, high_x, left, width),
        (y, camera.fy, camera.cy, low_y, high_y, top, height),
    ):
        slope = at / distance
        stretch = (1 + slope.clamp(low, high).square()).sqrt() * focal
        position = slope * focal
        # float32 rounds a position by 1e-7 of it: much where a sensor is shifted by 1e7 pixels
        rounding = 1 + 1e-6 * position.abs().clamp_max(1e30)
        reach = cutoff * ((sigma * stretch).square() + numerics.blur).sqrt() * 1.001 + rounding
        offset = position + (center - start)
        keep &= ~((offset < -reach) | (offset > size + reach))  # NaN is kept, to be refused
    return keep.nonzero().squeeze(-1)


def project(scene: Gaussians, camera: Camera, numerics: Numerics) -> Projected:
    """Project Gaussians that lie in front of the camera; differentiable in scene and pose."""
    # numbers of one kind beside each other: steps from row to row are long ones
    axes = rotation_matrices(scene.quats).permute(1, 2, 0) * scene.log_scales.T.exp()
    return project_axes(scene.means, axes.permute(2, 0, 1), camera, numerics)


def project_axes(
    means: Float[Tensor, "n 3"], axes: Float[Tensor, "n 3 3"], camera: Camera, numerics: Numerics
) -> Projected:
    """Project Gaussians of covariance A A^T; the columns of A are their axes in the world."""
    linear = _linearise(means, camera, numerics)
    first, second, third = axes.permute(1, 2, 0)
    m1, m2 = (
        (x * first).addcmul(y, second).addcmul(z, third) for x, y, z in (linear.to_x, linear.to_y)
    )
    xx = m1.square().sum(0)
    # divided before it is squared: the determinant overflows where the moments do not
    cross = torch.linalg.cross(m1 * (xx + numerics.blur).rsqrt(), m2, dim=0)
    moments = (xx, (m1 * m2).sum(0), m2.square().sum(0), cross.square().sum(0))
    return _whiten(means, linear, moments, numerics)


class _Linearised(NamedTuple):
    """The projection to first order about each center."""

    xy: Float[Tensor, "n 2"]
    depth: Float[Tensor, " n"]
    """Depth along the view, float64."""
    to_x: Float[Tensor, "3 n"]
    """Rows of J R_camera: how far a step in the world moves x, and y, on the picture."""
    to_y: Float[Tensor, "3 n"]


def _in_camera(means: Float[Tensor, "n 3"], camera: Camera) -> Float[Tensor, "3 n"]:
    """Centers in the camera's axes, float64."""
    pose = camera.world_to_camera.double()
    return pose[:3, :3] @ means.double().T + pose[:3, 3:]


def view_directions(means: Float[Tensor, "n 3"], camera: Camera) -> Float[Tensor, "n 3"]:
    """Unit vectors from the camera's center to each Gaussian's, taken in float64."""
    pose = camera.world_to_camera.double()
    center = -pose[:3, :3].T @ pose[:3, 3]
    return torch.nn.functional.normalize(means.double() - center, dim=-1).to(means)


def view_dependent_colors(
    sh: Float[Tensor, "n k 3"], means: Float[Tensor, "n 3"], camera: Camera
) -> Float[Tensor, "n 3"]:
    """Colors from the camera's position, not below 0; degree 0 needs no directions."""
    directions = means if sh.shape[1] == 1 else view_directions(means, camera)
    return harmonics.colors(sh, directions)


def _linearise(means: Float[Tensor, "n 3"], camera: Camera, numerics: Numerics) -> _Linearised:
    right, down, ahead = camera.rotation.to(means)[:, :, None]
    x, y, z = _in_camera(means, camera)
    if camera.model == "ortho":
        xy = _stack(means, camera.fx * x + camera.cx, camera.fy * y + camera.cy)
        to_x, to_y = camera.fx * right, camera.fy * down
        return _Linearised(xy, z, to_x.expand(-1, len(means)), to_y.expand(-1, len(means)))
    slope_x, slope_y = x / z, y / z
    xy = _stack(means, camera.fx * slope_x + camera.cx, camera.fy * slope_y + camera.cy)
    low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
    jx = slope_x.clamp(low_x, high_x).to(means)
    jy = slope_y.clamp(low_y, high_y).to(means)
    per_z = z.reciprocal().to(means)  # in float32 its gradient, 1 / z^2, underflows at z = 1e23
    return _Linearised(
        xy=xy,
        depth=z,
        to_x=(camera.fx * per_z) * (right - jx * ahead),
        to_y=(camera.fy * per_z) * (down - jy * ahead),
    )


def _whiten(
    means: Float[Tensor, "n 3"],
    linear: _Linearised,
    moments: tuple[Float[Tensor, " n"], ...],
    numerics: Numerics,
) -> Projected:
    """From the second moments xx, xy, yy on the picture, and their determinant over the blurred
    xx; all else unblurred."""
    s1, xy, s2, sharp = moments
    xx, yy = s1 + numerics.blur, s2 + numerics.blur
    conditional = sharp + numerics.blur * (1 + s2 / xx)  # the blurred determinant over xx
    w2 = conditional.rsqrt()
    compensation = None
    if numerics.antialiased:
        tiny = torch.finfo(sharp.dtype).tiny  # far below the floor, and no logarithm of zero
        compensation = 0.5 * (sharp.clamp_min(tiny).log() - conditional.log())
    return Projected(
        xy=linear.xy,
        whitening=_stack(means, xx.rsqrt(), -xy / xx * w2, w2),
        depth=linear.depth.to(means),
        sort_depth=linear.depth.detach(),
        covariance=_stack(means, xx, xy, yy, conditional * (xx / yy)).detach(),
        log_compensation=None if compensation is None else compensation.to(means),
    )


@torch.no_grad()
def covariance_of(whitening: Float[Tensor, "n 3"]) -> Float[Tensor, "n 4"]:
    """`Projected.covariance` of whitenings: the inverse of W^T W."""
    w0, w1, w2 = whitening.unbind(-1)
    xx = w0.square().reciprocal()
    xy = -w1 / w2 * xx
    conditional = w2.square().reciprocal()  # the variance of y at a given x
    yy = conditional + xy * xy / xx
    return torch.stack((xx, xy, yy, conditional * (xx / yy)), -1)


def _stack(like: Float[Tensor, "..."], *columns: Float[Tensor, " n"]) -> Float[Tensor, "n k"]:
    return torch.stack([column.to(like) for column in columns], -1)


def effective_log_opacities(
    projected: Projected, log_opacities: Float[Tensor, " n"], numerics: Numerics
) -> Float[Tensor, " n"]:
    """Log opacities to blend: with antialiasing; below the floor where `radius_clip` drops."""
    if projected.log_compensation is not None:
        log_opacities = log_opacities + projected.log_compensation
    if numerics.radius_clip > 0:
        radii = footprint_radii(projected.covariance, log_opacities, numerics)
        small = radii.amax(-1) <= numerics.radius_clip
        log_opacities = log_opacities.masked_fill(small, 2 * numerics.log_alpha_min)
    return log_opacities


@torch.no_grad()
def cutoff_radii(log_opacities: Float[Tensor, " n"], numerics: Numerics) -> Float[Tensor, " n"]:
    """Radii, in standard deviations, at which alpha falls to its floor; 0: never above it."""
    return (2 * (log_opacities - numerics.log_alpha_min)).clamp_min(0).sqrt()


@torch.no_grad()
def footprint_radii(
    covariance: Float[Tensor, "n 4"], log_opacities: Float[Tensor, " n"], numerics: Numerics
) -> Int[Tensor, "n 2"]:
    """Whole pixels that each footprint (`Projected.covariance`) reaches to its sides, and up and
    down; 0: never visible."""
    cutoff = cutoff_radii(log_opacities, numerics)
    return (cutoff[:, None] * covariance[:, ::2].sqrt()).ceil().int()
