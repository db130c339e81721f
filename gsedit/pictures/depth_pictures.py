"""Depth in color, for people: near is red, far is blue, with a legend."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from gsedit.runs.environment import load_extra

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
