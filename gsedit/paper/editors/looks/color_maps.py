"""Color maps: pictures in, recolored pictures out.

Nearly all map a pixel by its own color alone (sketch and watercolor look at its surroundings), so
one surface point gets one edited color in every view. `h w` pixels, sRGB in [0, 1]; any leading
axes. Colors are given as hexadecimal codes separated by blanks, from dark to bright.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.change.light.relight import step

Image = Float[Tensor, "*v h w 3"]
Grey = Float[Tensor, "*v h w 1"]
Map = Float[Tensor, "*v h w c"]
Values = Float[Tensor, "*d"]
ColorMap = Callable[[Image], Image]

LUMA = (0.299, 0.587, 0.114)  # Rec. 601: weights of gamma-coded R, G, B


def luma(images: Image) -> Grey:
    """Brightness of gamma-coded colors (Rec. 601)."""
    return (images * images.new_tensor(LUMA)).sum(-1, keepdim=True)


def colors(codes: str) -> list[tuple[float, float, float]]:
    """Hexadecimal codes, separated by blanks, as (red, green, blue) in [0, 1]."""
    return [
        (int(c[:2], 16) / 255, int(c[2:4], 16) / 255, int(c[4:], 16) / 255) for c in codes.split()
    ]


def gradient_map(brightness: Grey, codes: str) -> Image:
    """Colors evenly spaced over brightness 0 to 1, linear in between."""
    stops = brightness.new_tensor(colors(codes))
    position = brightness.clamp(0, 1) * (len(stops) - 1)
    # a sum of hinges: unlike a table look-up it keeps gradients, and the leading axes
    slopes = stops.diff(dim=0)
    slope_changes = torch.cat((slopes[:1], slopes.diff(dim=0)))
    hinges = (position - torch.arange(len(slope_changes)).to(position)).clamp_min(0)
    return stops[0] + hinges @ slope_changes


def s_curve(x: Values, amount: float) -> Values:
    """An S-curve about 0.45, where outdoor photos have their middle; 0 changes nothing."""
    return x + amount * (step(x, 0.0, 0.9) - x)


def ramp(codes: str, *, keep: float = 0.1, contrast: float = 0.6, gamma: float = 1.5) -> ColorMap:
    """Brightness becomes a color; `keep` of the original's color differences stays."""

    def apply(images: Image) -> Image:
        grey = luma(images)
        toned = gradient_map(s_curve(grey, contrast).clamp(0, 1) ** gamma, codes)
        return toned + keep * (images - grey)

    return apply


def snow(shade: str, bright: str, *, depth: float) -> ColorMap:
    """Bright, dull pixels are covered; dark or colorful ones still show through."""

    def apply(images: Image) -> Image:
        grey = luma(images)
        chroma = images.amax(-1, keepdim=True) - images.amin(-1, keepdim=True)
        cover = step(grey - 0.25 * chroma, 0.55 - depth, 0.85 - depth)
        bare = gradient_map(s_curve(grey, 0.5), f"0a0f18 {shade} {bright}") + 0.25 * (images - grey)
        fallen = images.new_tensor(colors(bright)[0]) * (0.5 + 0.5 * step(grey, 0.0, 1.0))
        return bare + cover * (fallen - bare)

    return apply


def foliage(leaf: str, tint: str) -> ColorMap:
    """Greens turn to a leaf color of their own brightness; the rest is warmed."""

    def apply(images: Image) -> Image:
        red, green, blue = images.split(1, -1)
        grey = luma(images)
        leafy = step(green - 0.5 * (red + blue), 0.0, 0.08)
        turned = gradient_map(s_curve(grey * 1.25, 0.5), f"140603 {leaf}")
        warmed = grey + 1.15 * (images - grey)
        warmed = s_curve(warmed, 0.3) * images.new_tensor(colors(tint)[0])
        return warmed + leafy * (turned - warmed)

    return apply


def veined(codes: str, vein: str, *, keep: float = 0.04) -> ColorMap:
    """A ramp with thin veins along lines of equal brightness, so they stay on the surface."""
    base = ramp(codes, keep=keep, contrast=0.35)

    def apply(images: Image) -> Image:
        phase = 6.0 * luma(images) + 1.5 * (images[..., :1] - images[..., 2:])
        line = (-((torch.sin(torch.pi * phase) / 0.12) ** 2)).exp()
        image = base(images)
        return image + 0.15 * line * (images.new_tensor(colors(vein)[0]) - image)

    return apply


def blur(images: Map, radius: int) -> Map:
    """A box of 2 radius + 1 pixels, twice (a tent); the border repeats the edge."""
    flat = images.reshape(-1, *images.shape[-3:]).movedim(-1, 1).contiguous()
    side = 2 * radius + 1
    for _ in range(2):
        flat = torch.nn.functional.pad(flat, (radius,) * 4, mode="replicate")
        for axis in (-2, -1):  # sums of shifted pictures: several times as fast as avg_pool2d
            length = flat.shape[axis] - 2 * radius
            shifted = (flat.narrow(axis, start, length) for start in range(side))
            flat = functools.reduce(torch.add, shifted) / side
    return flat.movedim(1, -1).reshape(images.shape)


def sketch(ink: str, paper: str) -> ColorMap:
    """Pencil: brightness over its surroundings leaves lines; a pale wash keeps the form."""

    def apply(images: Image) -> Image:
        grey = luma(images)
        lines = (grey / (blur(grey, 2) + 0.02)).clamp(0, 1) ** 2.5
        shading = 0.45 + 0.55 * step(grey, 0.05, 0.6)
        return gradient_map(lines * shading, f"{ink} {paper}")

    return apply


def watercolor(tint: str, saturation: float) -> ColorMap:
    """Soft flats that run into paper white, with pigment gathered at edges."""

    def apply(images: Image) -> Image:
        wash = blur(images, 1)
        grey = luma(wash)
        wash = (grey + saturation * (wash - grey)).clamp(0, 1) ** 0.7
        pigment = (grey - blur(grey, 2)).clamp(-0.08, 0.08)
        return (0.16 + 0.84 * wash) * images.new_tensor(colors(tint)[0]) + 1.6 * pigment

    return apply
