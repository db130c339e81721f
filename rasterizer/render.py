"""The picture of a scene: preprocess, splat, put over the background."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import checks
from rasterizer.blending.backend import median_depths, median_rows
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.cpp_projection.picture import draw
from rasterizer.numerics import AUTO, DEFAULT, Execution, Numerics, ruling
from rasterizer.preprocess import features_of, preprocess, stored_scene
from rasterizer.project import Box
from rasterizer.scene import Gaussians
from rasterizer.splat import splat


@dataclass(frozen=True, eq=False)
class Rendering:
    """Picture that a camera sees. Pixel [0, 0] is the top left."""

    color: Float[Tensor, "h w 3"]
    """Not clamped above; over the background."""
    alpha: Float[Tensor, "h w"]
    """Opacity of each pixel: 1 - transmittance."""
    depth: Float[Tensor, "h w"] | None = None
    """Expected depth of the centers along the view, divided by alpha; 0 where alpha is 0."""
    median_depth: Float[Tensor, "h w"] | None = None
    """Depth of the center at which the transmittance falls to one half; 0 where it does not. No
    gradient."""
    median_row: Int[Tensor, "h w"] | None = None
    """Row of that Gaussian in the scene; -1 where there is none."""


@torch.autocast("cpu", enabled=False)  # the eight bits of bfloat16 are too few
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
    an input, with its name and the first row. Allowed are log-scales of -inf (a point) and logit
    opacities of -inf and inf (0 and 1). SH of rows out of sight are not checked.
    """
    if background is not None:
        checks.all_finite("background", background)
    box, execution = crop or (0, 0, camera.width, camera.height), ruling(execution)
    drawn = draw(scene, camera, box, numerics, execution, depth=depth, median=median_depth)
    if drawn is None:
        source = stored_scene(scene)
        splats = preprocess(source, camera, box, numerics)
        features = features_of(source, splats, camera, depth=depth)
        made, _ = splat(splats, features, box, numerics, execution=execution, median=median_depth)
        drawn = made, splats.projected.depth.detach(), splats.rows
    (features, transmittance, index), depths, rows = drawn
    alpha, color = 1 - transmittance, features[..., :3]
    if background is not None:
        color = color + transmittance[..., None] * background.to(color)
    expected = features[..., 3] / alpha.masked_fill(alpha == 0, 1) if depth else None
    if index is None or depths is None:
        return Rendering(color, alpha, expected)
    return Rendering(color, alpha, expected, median_depths(depths, index), median_rows(rows, index))


@torch.no_grad()
def render_picture(
    scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT
) -> Float[Tensor, "h w 3"]:
    """Render the colors over black, clamped to [0, 1], without gradients, as files have them."""
    return render(scene, camera, numerics=numerics).color.clamp(0, 1)


def backproject(
    scene: Gaussians,
    camera: Camera,
    maps: Float[Tensor, "h w 3"],
    *,
    numerics: Numerics = DEFAULT,
    execution: Execution = AUTO,
) -> Float[Tensor, "n 3"]:
    """Sums over the picture of three maps' values, times each Gaussian's blending weight there.

    The adjoint of rendering colors. `maps` have the camera's size.
    """
    weights = color_weights(scene.detach(), camera, numerics=numerics, execution=execution)
    return weights.back(maps.detach().to(scene.means))


def contributions(scene: Gaussians, camera: Camera) -> Float[Tensor, " n"]:
    """Sum over the picture of each Gaussian's blending weight, pixels: how much it contributes."""
    ones = torch.ones(camera.height, camera.width, 1).expand(-1, -1, 3)
    return backproject(scene, camera, ones)[:, 0]
