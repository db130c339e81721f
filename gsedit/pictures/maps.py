"""Maps of a camera's view: color, alpha, depth (also in color), normals; two scenes as a wipe."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from math import log
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from gsedit.pictures import MapName
from gsedit.run.environment import load_extra
from gsedit.views.normals import facing, shortest_axes
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, SH_DC, Numerics
from rasterizer.render import render
from rasterizer.scene import Gaussians

SOLID = 0.5  # of alpha: a pixel shows a surface where at least half of it is covered
WIDE = 4.0  # times the near end: a scale that reaches farther is logarithmic
LEGEND = 22  # pixels: the height of the strip below the picture


def depth_range(depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"]) -> tuple[float, float]:
    """The near and far ends of a color scale: 2 % and 98 % of the depths of solid pixels.

    (0, 1) where nothing is solid; never an empty range.
    """
    solid = depth[(alpha > SOLID) & depth.isfinite()]
    if not len(solid):
        return 0.0, 1.0
    ordered = solid.detach().double().sort().values
    near, far = (float(ordered[round(q * (len(ordered) - 1))]) for q in (0.02, 0.98))
    return near, max(far, near + 1e-6 * max(abs(near), 1.0))


def is_logarithmic(near: float, far: float) -> bool:
    """Whether equal ratios of depth, not equal differences, are equal steps of color: outdoors,
    where the subject would else be all red."""
    return 0 < WIDE * near < far


def depth_colors(
    depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"], near: float, far: float
) -> UInt8[np.ndarray, "h w 3"]:
    """Depth in color: red at `near` or nearer, blue at `far` or farther, black where less than
    half of a pixel is covered."""
    z = depth.detach()
    if is_logarithmic(near, far):
        nearness = (far / z.clamp_min(near)).log() / log(far / near)
    else:
        nearness = (far - z) / (far - near)
    nearness = nearness.clamp(0, 1).nan_to_num()
    colors = _turbo()(nearness.cpu().numpy())[..., :3]
    colors = colors * (alpha.detach() > SOLID).cpu().numpy()[..., None]
    return (colors * 255).round().astype(np.uint8)


def depth_picture(depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"]) -> Image.Image:
    """Depth in color, near is red and far is blue, with the range (scene units) written below.

    Pixels less than half covered are black: they have no surface.
    """
    turbo = _turbo()
    near, far = depth_range(depth, alpha)
    picture = Image.fromarray(depth_colors(depth, alpha, near, far))

    legend = Image.new("RGB", (picture.width, LEGEND), "white")
    ramp = (turbo(np.linspace(1, 0, picture.width))[:, :3] * 255).round().astype(np.uint8)
    legend.paste(Image.fromarray(np.tile(ramp, (LEGEND // 3, 1, 1))), (0, 0))
    draw, font = ImageDraw.Draw(legend), ImageFont.load_default(11)
    draw.text((2, LEGEND // 3), f"{near:.3g}", fill="black", font=font)
    if is_logarithmic(near, far):
        middle = f"{(near * far) ** 0.5:.3g}"
        draw.text((picture.width / 2, LEGEND // 3), middle, fill="black", font=font, anchor="ma")
    draw.text((picture.width - 2, LEGEND // 3), f"{far:.3g}", fill="black", font=font, anchor="ra")

    joined = Image.new("RGB", (picture.width, picture.height + LEGEND))
    joined.paste(picture, (0, 0))
    joined.paste(legend, (0, picture.height))
    return joined


def _turbo() -> Any:
    """The color map. Raises GseditError without matplotlib."""
    return load_extra("matplotlib", "depth in color").colormaps["turbo"]


FAINT = 1e-4
"""Length of a blended normal below which rounding decides its direction."""


@dataclass(frozen=True, eq=False)
class Maps:
    """Maps of one camera's view. Pixel [0, 0] is the top left."""

    color: Float[Tensor, "h w 3"]
    """sRGB; not clamped above; over the background."""
    alpha: Float[Tensor, "h w"]
    """In [0, 1]: 1 - transmittance."""
    depth: Float[Tensor, "h w"] | None = None
    """Along the view, world units: of the center at which the transmittance falls to one half; 0
    where it does not."""
    normals: Float[Tensor, "h w 3"] | None = None
    """Unit vectors in the camera's axes x right, y up, z towards the viewer; 0 where nothing is
    (see `normal_map`)."""


@torch.no_grad()
def render_maps(
    scene: Gaussians,
    camera: Camera,
    wanted: Collection[MapName] = ("color",),
    *,
    background: Float[Tensor, "3"] | None = None,
    numerics: Numerics = DEFAULT,
) -> Maps:
    """The wanted maps of a view; color and alpha are always there. `normals` cost a second render,
    of SH degree 0."""
    drawn = render(
        scene, camera, background=background, median_depth="depth" in wanted, numerics=numerics
    )
    normals = None
    if "normals" in wanted:
        normals = normal_map(scene, camera, numerics=numerics)
    return Maps(drawn.color, drawn.alpha, drawn.median_depth, normals)


@torch.no_grad()
def normal_map(
    scene: Gaussians, camera: Camera, *, numerics: Numerics = DEFAULT
) -> Float[Tensor, "h w 3"]:
    """Unit normals: the Gaussians' shortest axes, turned to the camera, blended as colors are.

    In the camera's axes x right, y up, z towards the viewer, as normal maps have it; 0 where
    nothing is. Each counts by how flat it is, 1 - shortest / middle standard deviation: a ball or a
    needle says nothing of a surface. (From depth, which is that of centers, the normals of a sphere
    of discs are wrong by several times as much: docs/measurements/toolkit.md.)
    """
    axes = facing(shortest_axes(scene), scene, camera) @ camera.rotation.to(scene.means).T
    axes = axes * axes.new_tensor((1.0, -1.0, -1.0))  # y up, z to the viewer
    # as colors in [0, 1]: the blend of n / 2 + 1 / 2 is (the blend of n) / 2 + alpha / 2
    colored = replace(scene, sh=(axes / 2 / SH_DC)[:, None])
    drawn = render(colored, camera, numerics=numerics)
    blended = 2 * drawn.color - drawn.alpha[..., None]
    length = blended.norm(dim=-1, keepdim=True)
    return blended / length.clamp_min(FAINT) * (length > FAINT)


@torch.no_grad()
def wipe(
    before: Gaussians,
    after: Gaussians,
    camera: Camera,
    share: float,
    *,
    background: Float[Tensor, "3"] | None = None,
    numerics: tuple[Numerics, Numerics] = (DEFAULT, DEFAULT),
) -> Float[Tensor, "h w 3"]:
    """The picture of `before` on the left `share` of the width, in [0, 1], that of `after` on the
    rest, and a white line with dark borders between them, 1/200 of the width, at least 2 pixels.

    Each scene is rendered only where it shows; `numerics` are those of `before` and of `after`.
    """
    width, height = camera.width, camera.height
    edge = min(max(round(share * width), 0), width)
    parts = [
        render(
            scene, camera, crop=(left, 0, size, height), background=background, numerics=own
        ).color
        for scene, own, left, size in (
            (before, numerics[0], 0, edge),
            (after, numerics[1], edge, width - edge),
        )
        if size
    ]
    picture = torch.cat(parts, 1)
    if 0 < edge < width:
        half = max(1, round(width / 400))
        picture[:, max(0, edge - half - 1) : edge + half + 1] = 0.2
        picture[:, max(0, edge - half) : edge + half] = 1
    return picture
