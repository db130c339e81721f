"""The same picture by the textbook, in float64: the definition of correct; slow.

Every pixel sums all Gaussians, front to back, by the plain formula: conic (inverse covariance),
alpha capped and floored, no early stop. Blocks of pixels only skip Gaussians whose alpha there is
certainly below the floor.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from rasterizer import harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.project import rotation_matrices, slope_limits
from rasterizer.render import Rendering
from rasterizer.scene import Gaussians

SIDE = 16  # pixels of a block's side; changes memory and time, not the result


def render_reference(
    scene: Gaussians,
    camera: Camera,
    *,
    background: Tensor | None = None,
    numerics: Numerics = DEFAULT,
    dtype: torch.dtype = torch.float64,
) -> Rendering:
    """Colour, alpha and both depths of a scene, as `render` defines them.

    In float64 it is the truth. In another `dtype` it is the textbook's formula at that precision:
    what is lost by it, and may then be infinite or NaN.
    """
    scene = scene.to(dtype)
    pose = camera.world_to_camera.to(dtype)
    centres = scene.means @ pose[:3, :3].T + pose[:3, 3]
    depth = centres[:, 2].detach()
    front = (depth > numerics.near) & (depth <= numerics.far)
    order = front.nonzero().squeeze(-1)
    order = order[torch.argsort(centres[order, 2].detach(), stable=True)]
    scene, centres = scene[order], centres[order]
    x, y, z = centres.unbind(-1)

    jacobian = torch.zeros(len(scene), 2, 3, dtype=dtype)
    if camera.model == "ortho":
        jacobian[:, 0, 0], jacobian[:, 1, 1] = camera.fx, camera.fy
    else:
        low_x, high_x, low_y, high_y = slope_limits(camera, numerics)
        jacobian[:, 0, 0], jacobian[:, 1, 1] = camera.fx / z, camera.fy / z
        jacobian[:, 0, 2] = -camera.fx / z * (x / z).clamp(low_x, high_x)
        jacobian[:, 1, 2] = -camera.fy / z * (y / z).clamp(low_y, high_y)
    factor = jacobian @ pose[:3, :3] @ rotation_matrices(scene.quats) * scene.scales[:, None, :]
    covariance = factor @ factor.mT + numerics.blur * torch.eye(2, dtype=dtype)
    xy, _ = camera.project(scene.means)
    features = torch.cat(
        (harmonics.colors(scene.sh, scene.means - camera.centre.to(scene.means)), z[:, None]), -1
    )
    opacities = scene.opacities
    if numerics.antialiased:
        # det(F F^T) = |f1 x f2|^2 (Cauchy-Binet), whose root has no gradient at 0
        sharp = torch.linalg.vector_norm(torch.linalg.cross(*factor.unbind(1)), dim=-1)
        opacities = opacities * sharp / torch.linalg.det(covariance).sqrt()
    radius = (2 * (opacities / numerics.alpha_min).log().clamp_min(0)).sqrt()
    reach = (radius[:, None] * covariance.diagonal(dim1=-2, dim2=-1).sqrt()).detach()
    clipped = (reach.ceil() <= numerics.radius_clip).all(-1) & (numerics.radius_clip > 0)
    opacities = opacities.masked_fill(clipped, 0)
    reach = reach * (1 + 1e-6) + 1e-6  # a superset

    def block(left: int, top: int) -> tuple[Tensor, Tensor, Tensor]:
        width, height = min(SIDE, camera.width - left), min(SIDE, camera.height - top)
        low = xy.new_tensor((left, top))
        high = low + xy.new_tensor((width, height))
        near = ((xy.detach() > low - reach) & (xy.detach() < high + reach)).all(-1)
        pixels = camera.pixel_centres()[top : top + height, left : left + width]
        pixels = pixels.to(dtype).reshape(-1, 2)
        return _blend(pixels, xy[near], covariance[near], opacities[near], features[near], numerics)

    needs_grad = torch.is_grad_enabled() and any(
        t.requires_grad for t in (xy, covariance, features, opacities)
    )
    rows = []
    for top in range(0, camera.height, SIDE):
        blocks = [
            checkpoint(block, left, top, use_reentrant=False) if needs_grad else block(left, top)
            for left in range(0, camera.width, SIDE)
        ]
        height = min(SIDE, camera.height - top)
        rows.append(
            tuple(
                torch.cat([part.view(height, -1, part.shape[-1]) for part in parts], 1)
                for parts in zip(*blocks)
            )
        )
    color, alpha, median = (torch.cat(parts, 0) for parts in zip(*rows))
    alpha, median = alpha[..., 0], median[..., 0]
    depth = color[..., 3] / alpha.masked_fill(alpha == 0, 1)
    color = color[..., :3]
    if background is not None:
        color = color + (1 - alpha)[..., None] * background.to(color)
    return Rendering(color, alpha, depth, median.detach())


def _blend(
    pixels: Tensor, xy: Tensor, covariance: Tensor, opacities: Tensor, features: Tensor,
    numerics: Numerics,
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    """Blended features, alpha and median depth (the last feature) of some pixels."""
    offset = pixels[:, None, :] - xy
    a, b, c, d = covariance.flatten(1).unbind(-1)
    adjugate = torch.stack((d, -b, -c, a), -1).view(-1, 2, 2)
    conic = adjugate / (a * d - b * c)[:, None, None]
    power = 0.5 * torch.einsum("pni,nij,pnj->pn", offset, conic, offset)
    alpha = (opacities * torch.exp(-power)).clamp_max(numerics.alpha_max)
    alpha = torch.where(alpha >= numerics.alpha_min, alpha, 0.0)
    passed = torch.cat((torch.ones_like(pixels[:, :1]), torch.cumprod(1 - alpha, -1)), -1)
    before, after = passed[:, :-1], passed[:, 1:]
    crossing = ((before > 0.5) & (after <= 0.5)).to(features)
    return (before * alpha) @ features, 1 - passed[:, -1:], crossing @ features[:, -1:].detach()
