"""The picture of a scene: project, sort into tiles, blend, put over the background."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import logsigmoid

from rasterizer import checks, harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, DEFAULT, SH_DC, Execution, Numerics
from rasterizer.project import Box, colors_seen, drawn_log_opacities, project, visible
from rasterizer.scene import Gaussians
from rasterizer.splat import splat


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a camera sees. Pixel [0, 0] is the top left."""

    color: Float[Tensor, "h w 3"]
    """Not clamped above; over the background."""
    alpha: Float[Tensor, "h w"]
    """1 - transmittance."""
    depth: Float[Tensor, "h w"] | None = None
    """Expected depth of the centres along the view, divided by alpha; 0 where alpha is 0."""
    median_depth: Float[Tensor, "h w"] | None = None
    """Where the transmittance falls to one half; 0 where it does not. No gradient."""


@torch.autocast("cpu", enabled=False)  # eight bits would not do
def render(
    scene: Gaussians,
    camera: Camera,
    *,
    background: Float[Tensor, "3"] | None = None,
    crop: Box | None = None,
    depth: bool = False,
    median_depth: bool = False,
    numerics: Numerics = DEFAULT,
    execution: Execution = AUTO,
) -> Rendering:
    """Render Gaussians; differentiable in the scene, the background and the camera's pose.

    `crop` (left, top, width, height) renders that part of the same picture at about the cost of its
    area. `background` is black if None. float32 or float64, as the scene is.

    Raises ValueError for an empty crop, or one that leaves the picture; and for NaN or infinity in
    an input, with its name and the first row. Two are meant: log-scales of -inf (a point), logit
    opacities of -inf and inf (0 and 1). SH of rows that are not in sight are not looked at.
    """
    checks.settings(numerics)
    checks.camera(camera)
    checks.scene(scene)
    if background is not None:
        checks.all_finite("background", background)
    box = crop or (0, 0, camera.width, camera.height)
    left, top, width, height = box
    inside = (
        left >= 0 and top >= 0 and left + width <= camera.width and top + height <= camera.height
    )
    if not inside or min(width, height) < 1:
        raise ValueError(f"crop {box} does not lie in a picture of {camera.width}x{camera.height}")
    scene = replace(scene, sh=harmonics.without_zeros(scene.sh))
    rows = visible(scene, camera, box, numerics)
    seen = scene[rows]
    checks.finite("sh", seen.sh, rows)
    projected = project(seen, camera, numerics)
    checks.footprints(projected, rows)
    features = [colors_seen(seen.sh, seen.means, camera)]
    checks.finite("sh", features[0], rows)  # sums of finite numbers may overflow
    if depth:
        features.append(projected.depth[:, None])
    drawn = splat(
        projected,
        drawn_log_opacities(projected, logsigmoid(seen.logit_opacities), numerics),
        torch.cat(features, -1),
        box,
        numerics,
        execution=execution,
        median=median_depth,
    )
    alpha = 1 - drawn.transmittance
    color = drawn.features[..., :3]
    if background is not None:
        color = color + drawn.transmittance[..., None] * background.to(color)
    expected = median = None
    if depth:
        expected = drawn.features[..., 3] / alpha.masked_fill(alpha == 0, 1)
    if median_depth:
        centres = torch.cat((projected.depth.detach(), projected.depth.new_zeros(1)))
        median = centres[drawn.crossing]  # -1, nothing there, reads the zero at the end
    return Rendering(color, alpha, expected, median)


def contributions(
    scene: Gaussians, camera: Camera, *, numerics: Numerics = DEFAULT, execution: Execution = AUTO
) -> Float[Tensor, " n"]:
    """Sum over the picture of each Gaussian's blending weight, in pixels: how much of it is
    seen.
    """
    # the picture is linear in colour, so this is the gradient of its sum
    with torch.inference_mode(False), torch.enable_grad():
        flat = scene.map(lambda field: field.detach().clone())
        dc = torch.zeros(len(scene), 1, 3, dtype=flat.means.dtype, requires_grad=True)
        picture = render(replace(flat, sh=dc), camera, numerics=numerics, execution=execution).color
        (gradient,) = torch.autograd.grad(picture[..., 0].sum(), dc)
    return gradient[:, 0, 0] / SH_DC
