"""Formulas of the looks: functions from pictures with geometry to whole edited pictures.

Blur radii are shares of the picture's height. Most formulas use a pixel's color, depth and normal
alone; the gradients of skies and water also use its row, materials the subject's mean brightness.
`n` pictures of `h w` pixels, sRGB in [0, 1]; shares are in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.looks.color_maps import (
    blur,
    cartoon,
    colors,
    gradient_map,
    luma,
    ramp,
    s_curve,
    smoothstep,
)
from research.train_small.sources import Pictures, Shares, Sources

LookFunction: TypeAlias = Callable[[Sources], Pictures]
"""From unedited to whole edited pictures, not clamped."""

MIDDLE = 0.45  # brightness that a subject's mean is moved toward before it becomes a material
RELIEF = 0.3  # share of a material's shading that comes from the normal, not from the picture
SKY_FROM, SKY_TO = 4.0, 7.5  # depths, in distances of the subject, where the sky fades in


# Measures of a picture


def sky(sources: Sources) -> Shares:
    """Select the sky: far pixels without a surface."""
    bare = 1 - sources.normal.square().sum(-1, keepdim=True)
    return smoothstep(sources.depth, SKY_FROM, SKY_TO) * bare.clamp(0, 1)


def upward(sources: Sources, low: float, high: float) -> Shares:
    """Faces whose normal's height is above `low`, wholly above `high`."""
    return smoothstep(sources.normal[..., 2:], low, high)


def ground(sources: Sources) -> Shares:
    """Level surfaces that are not the subject."""
    return upward(sources, 0.5, 0.9) * (1 - sources.subject)


def haze(sources: Sources, start: float, density: float) -> Shares:
    """Share of a surface's color lost to haze: 0 up to depth `start`, then 1 - exp(-density d)."""
    return 1 - (-density * (sources.depth - start).clamp_min(0)).exp()


def height(sources: Sources) -> Float[Tensor, "h 1 1"]:
    """1 in the picture's top row, 0 in the lowest."""
    rows = sources.image.shape[-3]
    return torch.linspace(1, 0, rows).to(sources.image)[:, None, None]


def shading(sources: Sources, relief: float = RELIEF) -> Shares:
    """Brightness of the subject with its mean moved toward MIDDLE, mixed with its shape lit from
    above."""
    grey = luma(sources.image)
    weight = sources.subject.sum((-3, -2), keepdim=True)
    mean = (sources.subject * grey).sum((-3, -2), keepdim=True) / weight.clamp_min(1e-6)
    mean = torch.where(weight > 0, mean, torch.full_like(mean, MIDDLE)).clamp_min(0.02)
    lit = 0.15 + 0.3 * (1 + sources.normal[..., 2:])
    return (1 - relief) * (grey * (MIDDLE / mean) ** 0.75).clamp(0, 1) + relief * lit


def edges(grey: Shares, reach: float = 0.012) -> Shares:
    """Standard deviation of the brightness around a pixel; `reach` is a share of the picture's
    height."""
    radius = pixel_count(grey, reach)
    mean = blur(grey, radius)
    return (blur(grey.square(), radius) - mean.square()).clamp_min(1e-8).sqrt()


def pixel_count(images: Float[Tensor, "n h w c"], share: float) -> int:
    """A share of the picture's height, in whole pixels, at least 1."""
    return max(1, round(share * images.shape[-3]))


def mix(first: Pictures, second: Float[Tensor, "*n 3"] | str, share: Shares | float) -> Pictures:
    """Interpolated from the first (share 0) to the second (share 1), which may be a hex color."""
    if isinstance(second, str):
        second = first.new_tensor(colors(second)[0])
    return first + share * (second - first)


def saturate(images: Pictures, amount: float) -> Pictures:
    """Distance to grey multiplied by `amount`; not clamped."""
    grey = luma(images)
    return grey + amount * (images - grey)


# Looks of the subject


def solid(
    codes: str, *, contrast: float = 0.35, gamma: float = 1.0, keep: float = 0.04
) -> LookFunction:
    """A material: the subject's shading becomes its colors, dark to bright."""

    def look(sources: Sources) -> Pictures:
        shade = s_curve(shading(sources), contrast).clamp(0, 1) ** gamma
        return gradient_map(shade, codes) + keep * (sources.image - luma(sources.image))

    return look


def metal(codes: str) -> LookFunction:
    """A material that mirrors: a bright sky on upper faces, a dark horizon on upright ones."""

    def look(sources: Sources) -> Pictures:
        up = sources.normal[..., 2:]
        gleam = (-((up - 0.5) / 0.2).square()).exp()
        horizon = (-((up - 0.02) / 0.14).square()).exp() * sources.normal.square().sum(
            -1, keepdim=True
        )
        shade = s_curve(shading(sources, 0.2), 0.8)
        return gradient_map((shade + 0.28 * gleam - 0.14 * horizon).clamp(0, 1), codes)

    return look


def streaked(codes: str, vein: str, frequency: float, strength: float) -> LookFunction:
    """A material with lines of another color, along equal brightness and equal slope."""

    def look(sources: Sources) -> Pictures:
        shade = shading(sources)
        broad = blur(shade, pixel_count(shade, 0.02))
        phase = frequency * (1.3 * broad + 0.5 * sources.normal[..., 2:])
        line = (-(torch.sin(torch.pi * phase) / 0.3).square()).exp()
        return mix(gradient_map(s_curve(shade, 0.3), codes), vein, strength * line)

    return look


def painted(color: str) -> LookFunction:
    """Plain paint: the shading times one color, with a soft shine."""

    def look(sources: Sources) -> Pictures:
        shade = shading(sources)
        base = shade.new_tensor(colors(color)[0]) * (0.3 + 1.1 * shade).clamp_max(1.05)
        return base + 0.3 * smoothstep(shade, 0.7, 1.0)

    return look


def mossy(codes: str) -> LookFunction:
    """Moss: cushions on upper faces, green in the folds, damp dark below."""

    def look(sources: Sources) -> Pictures:
        shade = shading(sources, 0.15)
        cover = 0.55 + 0.45 * upward(sources, -0.5, 0.3)
        damp = mix(saturate(sources.image, 0.5) * 0.5, "28301c", 0.4)
        return mix(damp, gradient_map(s_curve(shade, 0.6), codes), cover)

    return look


# Looks of the scene


def snow(sources: Sources) -> Pictures:
    grey = luma(sources.image)
    settled = torch.maximum(upward(sources, 0.1, 0.5), haze(sources, 2.0, 0.5))
    cold = mix(saturate(sources.image, 0.5) * 0.85, "8ca0b8", 0.25)
    white = grey.new_tensor(colors("f4f8ff")[0]) * (0.66 + 0.36 * smoothstep(grey, 0.0, 0.7))
    return mix(mix(cold, white, 0.9 * settled), "dce4ee", sky(sources))


def fog(sources: Sources) -> Pictures:
    lost = 1 - 0.72 * (1 - haze(sources, 0.6, 0.75))
    return mix(saturate(sources.image, 0.6), "b2b6ba", lost)


def desert(sources: Sources) -> Pictures:
    lost = 1 - 0.9 * (1 - haze(sources, 0.7, 0.5))
    sand = gradient_map(0.25 + 0.75 * luma(sources.image), "2c1808 a06c30 e0a860 f4d8a0")
    settled = mix(saturate(sources.image, 0.6), sand, 0.5 + 0.4 * ground(sources))
    return mix(settled, "d89c50", lost)


def underwater(sources: Sources) -> Pictures:
    """Water takes red first, and gives back its own blue-green with distance."""
    lit = 0.75 + 0.5 * upward(sources, -0.2, 0.9)
    filtered = sources.image * sources.image.new_tensor((0.25, 1.0, 1.05)) * lit
    water = gradient_map(height(sources), "02303c 04647c 18a0b4")
    return mix(filtered, water.expand_as(filtered), 1 - 0.75 * (1 - haze(sources, 0.8, 0.5)))


def night(sources: Sources) -> Pictures:
    base = ramp("01030c 081430 1c3868 5078b0 b8d0f0", keep=0.12, contrast=0.5, gamma=1.5)
    dark = gradient_map(height(sources), "122448 040818").expand_as(sources.image)
    return mix(base(sources.image), dark, sky(sources))


def sunset(sources: Sources) -> Pictures:
    """A low sun on upright and bright faces, the violet sky on the others."""
    upright = 1 - sources.normal[..., 2:].square()
    sun = (0.8 * smoothstep(upright, 0.1, 0.9) + 0.9 * luma(sources.image) - 0.3).clamp(0, 1)
    shadow = sources.image * sources.image.new_tensor((0.52, 0.34, 0.52))
    warm = mix(sources.image, "ffa040", 0.3) * sources.image.new_tensor((1.3, 0.75, 0.36))
    glow = gradient_map(height(sources), "ffb040 ff7038 c04868 583070").expand_as(warm)
    lit = mix(shadow, warm, sun)
    return mix(mix(lit, "f08040", 0.5 * haze(sources, 1.2, 0.4)), glow, 0.95 * sky(sources))


def season(leaf: str, tint: str, air: str) -> LookFunction:
    """Greens and the ground get the colors of `leaf`, the rest is tinted, the sky is `air`."""

    def look(sources: Sources) -> Pictures:
        red, green, blue = sources.image.split(1, -1)
        grey = luma(sources.image)
        leafy = smoothstep(green - 0.5 * (red + blue), 0.0, 0.08)
        leafy = torch.maximum(leafy * (1 - sky(sources)), 0.85 * ground(sources))
        tinted = saturate(sources.image, 1.2) * grey.new_tensor(colors(tint)[0])
        turned_leaves = gradient_map(s_curve(grey * 1.1, 0.4), leaf)
        return mix(mix(tinted, turned_leaves, leafy), air, 0.7 * sky(sources))

    return look


def rain(sources: Sources) -> Pictures:
    """Dull colors; wet ground is dark and reflects the sky."""
    dull = mix(saturate(sources.image, 0.3) * 0.62, "405470", 0.3)
    wet = mix(dull * 0.75, "8490a0", 0.35 * upward(sources, 0.8, 1.0))
    shown = mix(dull, wet, ground(sources))
    return mix(mix(shown, "6c7c94", 0.6 * haze(sources, 1.5, 0.3)), "7888a0", sky(sources))


def sketch(sources: Sources) -> Pictures:
    grey = luma(sources.image)
    around = blur(grey, pixel_count(grey, 0.02))
    lines = (grey / (around + 0.02)).clamp(0, 1) ** 2.5
    inked = lines - 3.0 * (edges(grey, 0.006) - 0.03).clamp(0, 0.2)
    tone = 0.78 + 0.22 * smoothstep(grey, 0.05, 0.6)
    return gradient_map((inked * tone).clamp(0, 1), "202024 fcfcf8")


def watercolor(sources: Sources) -> Pictures:
    """Watercolor: soft flats that run into paper white, pigment gathered at edges."""
    wash = blur(sources.image, pixel_count(sources.image, 0.01))
    grey = luma(wash)
    pale = 0.42 + 0.58 * saturate(wash, 2.6).clamp(0, 1)
    pigment = (grey - blur(grey, pixel_count(grey, 0.03))).clamp(-0.08, 0.08)
    return pale * grey.new_tensor(colors("fff8ea")[0]) + 2.4 * pigment


def outlined_cartoon(sources: Sources) -> Pictures:
    """Cartoon: flat strong colors within black outlines."""
    flat = cartoon(4, 2.6, 0.7, "ffffff")(blur(sources.image, pixel_count(sources.image, 0.008)))
    grey = luma(sources.image)
    outline = smoothstep(edges(grey, 0.006), 0.06, 0.14)
    return flat.clamp(0, 1) * (1 - 0.95 * outline)


def blueprint(sources: Sources) -> Pictures:
    grey = luma(sources.image)
    lines = smoothstep(edges(grey, 0.006), 0.04, 0.14)
    return mix(gradient_map(0.6 * grey, "0a2c80 1c50b8 3c74cc"), "f0f8ff", 0.95 * lines)


def pop_art(sources: Sources) -> Pictures:
    """Pop art: four printed colors."""
    grey = luma(blur(sources.image, pixel_count(sources.image, 0.004)))
    stops = colors("10285c e0202c f8c020 fff4d0")
    image = grey.new_tensor(stops[0]).expand_as(sources.image)
    for stop, threshold in zip(stops[1:], (0.28, 0.48, 0.7)):
        share = smoothstep(grey, threshold - 0.04, threshold + 0.04)
        image = mix(image, grey.new_tensor(stop), share)
    return image


def polaroid(sources: Sources) -> Pictures:
    """A faded print: lifted violet blacks, peach whites, weak colors."""
    faded = gradient_map(luma(sources.image), "684c68 c0908c fce0b8")
    return mix(faded, sources.image, 0.25)


def toned(factors: tuple[float, float, float]) -> LookFunction:
    return lambda sources: sources.image * sources.image.new_tensor(factors)


def on_image(change: Callable[[Pictures], Pictures]) -> LookFunction:
    return lambda sources: change(sources.image)
