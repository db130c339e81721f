"""Picture of a scene by the textbook, in float64: the definition of correct; slow.

Every pixel sums all Gaussians, front to back, by the plain formula: conic (inverse covariance),
alpha capped and floored, no early stop. Blocks of pixels only skip Gaussians whose alpha there is
certainly below the floor.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from rasterizer import harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.project import near_plane, rotation_matrices, slope_limits
from rasterizer.render import Rendering
from rasterizer.scene import Gaussians

SIDE = 16  # pixels of a block's side; changes memory and time, not the result


def render_reference(
    scene: Gaussians,
    camera: Camera,
    *,
    background: Float[Tensor, "3"] | None = None,
    numerics: Numerics = DEFAULT,
    dtype: torch.dtype = torch.float64,
) -> Rendering:
    """Color, alpha and both depths of a scene, as `render` defines them.

    In float64 it is the ground truth. In another `dtype` it shows what the textbook's formula loses
    at that precision, and may be infinite or NaN.
    """
    flat = _project(scene.to(dtype), camera, numerics)
    features, alpha, median = _draw(flat, camera, numerics)
    depth = features[..., 3] / alpha.masked_fill(alpha == 0, 1)
    color = features[..., :3]
    if background is not None:
        color = color + (1 - alpha)[..., None] * background.to(color)
    return Rendering(color, alpha, depth, median.detach())


class _Flat(NamedTuple):
    """2D Gaussians between the planes, front to back."""

    xy: Float[Tensor, "n 2"]
    covariance: Float[Tensor, "n 2 2"]
    """Covariances on the picture, blurred."""
    features: Float[Tensor, "n 4"]
    """Color, then depth along the view."""
    opacities: Float[Tensor, " n"]
    """Antialiased; 0 where `radius_clip` drops."""


def _project(scene: Gaussians, camera: Camera, numerics: Numerics) -> _Flat:
    dtype = scene.means.dtype
    pose = camera.world_to_camera.to(dtype)
    centers = scene.means @ pose[:3, :3].T + pose[:3, 3]
    depth = centers[:, 2].detach()
    front = (depth > near_plane(camera, numerics)) & (depth <= numerics.far)
    order = front.nonzero().squeeze(-1)
    order = order[torch.argsort(centers[order, 2].detach(), stable=True)]
    scene = scene[order]
    x, y, z = centers[order].unbind(-1)
    jacobian = _jacobian(x, y, z, camera, numerics)
    factor = jacobian @ pose[:3, :3] @ rotation_matrices(scene.quats) * scene.scales[:, None, :]
    covariance = factor @ factor.mT + numerics.blur * torch.eye(2, dtype=dtype)
    xy, _ = camera.project(scene.means)
    directions = scene.means - camera.center.to(scene.means)
    features = torch.cat((harmonics.colors(scene.sh, directions), z[:, None]), -1)
    opacities = scene.opacities
    if numerics.antialiased:
        # det(F F^T) = |f1 x f2|^2 (Cauchy-Binet), whose root has no gradient at 0
        sharp = torch.linalg.vector_norm(torch.linalg.cross(*factor.unbind(1)), dim=-1)
        opacities = opacities * sharp / torch.linalg.det(covariance).sqrt()
    flat = _Flat(xy, covariance, features, opacities)
    clipped = (_reach(flat, numerics).ceil() <= numerics.radius_clip).all(-1)
    clipped &= numerics.radius_clip > 0
    return flat._replace(opacities=opacities.masked_fill(clipped, 0))


def _jacobian(
    x: Float[Tensor, " n"],
    y: Float[Tensor, " n"],
    z: Float[Tensor, " n"],
    camera: Camera,
    numerics: Numerics,
) -> Float[Tensor, "n 2 3"]:
    """Derivatives of pixel positions by positions in the camera's axes."""
    jacobian = z.new_zeros(len(z), 2, 3)
    if camera.model == "ortho":
        jacobian[:, 0, 0], jacobian[:, 1, 1] = camera.fx, camera.fy
        return jacobian
    low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
    jacobian[:, 0, 0], jacobian[:, 1, 1] = camera.fx / z, camera.fy / z
    jacobian[:, 0, 2] = -camera.fx / z * (x / z).clamp(low_x, high_x)
    jacobian[:, 1, 2] = -camera.fy / z * (y / z).clamp(low_y, high_y)
    return jacobian


def _reach(flat: _Flat, numerics: Numerics) -> Float[Tensor, "n 2"]:
    """Pixels, across and down, from each center to where alpha is at its floor."""
    radius = (2 * (flat.opacities / numerics.alpha_min).log().clamp_min(0)).sqrt()
    return (radius[:, None] * flat.covariance.diagonal(dim1=-2, dim2=-1).sqrt()).detach()


def _draw(
    flat: _Flat, camera: Camera, numerics: Numerics
) -> tuple[Float[Tensor, "h w 4"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Blended features, alpha and median depth of all pixels, block by block."""
    xy, reach = flat.xy, _reach(flat, numerics) * (1 + 1e-6) + 1e-6  # a superset

    def block(left: int, top: int) -> tuple[Tensor, Tensor, Tensor]:
        width, height = min(SIDE, camera.width - left), min(SIDE, camera.height - top)
        low = xy.new_tensor((left, top))
        high = low + xy.new_tensor((width, height))
        near = ((xy.detach() > low - reach) & (xy.detach() < high + reach)).all(-1)
        pixels = camera.pixel_centers()[top : top + height, left : left + width]
        pixels = pixels.to(xy).reshape(-1, 2)
        return _blend(pixels, _Flat(*(field[near] for field in flat)), numerics)

    if torch.is_grad_enabled() and any(field.requires_grad for field in flat):
        block = partial(checkpoint, block, use_reentrant=False)
    rows = []
    for top in range(0, camera.height, SIDE):
        blocks = [block(left, top) for left in range(0, camera.width, SIDE)]
        height = min(SIDE, camera.height - top)
        rows.append(
            [
                torch.cat([part.view(height, -1, part.shape[-1]) for part in parts], 1)
                for parts in zip(*blocks)
            ]
        )
    features, alpha, median = (torch.cat(parts, 0) for parts in zip(*rows))
    return features, alpha[..., 0], median[..., 0]


def _blend(
    pixels: Float[Tensor, "p 2"], flat: _Flat, numerics: Numerics
) -> tuple[Float[Tensor, "p 4"], Float[Tensor, "p 1"], Float[Tensor, "p 1"]]:
    """Blended features, alpha and median depth (the last feature) of some pixels."""
    xy, covariance, features, opacities = flat
    offset = pixels[:, None, :] - xy
    a, b, c, d = covariance.flatten(1).unbind(-1)
    adjugate = torch.stack((d, -b, -c, a), -1).view(-1, 2, 2)
    conic = adjugate / (a * d - b * c)[:, None, None]
    power = 0.5 * torch.einsum("pni,nij,pnj->pn", offset, conic, offset)
    alpha = (opacities * torch.exp(-power)).clamp_max(numerics.alpha_max)
    alpha = torch.where(alpha >= numerics.alpha_min, alpha, 0.0)
    passed = torch.cat((torch.ones_like(pixels[:, :1]), torch.cumprod(1 - alpha, -1)), -1)
    before, after = passed[:, :-1], passed[:, 1:]
    at_median = ((before > 0.5) & (after <= 0.5)).to(features)
    return (before * alpha) @ features, 1 - passed[:, -1:], at_median @ features[:, -1:].detach()
