"""The edits that the small model learns: what a picture must become, by the name of the look.

A look is a smooth function of a pixel's colour, normal and depth, with blurs relative to the
picture's size: nearly one colour for a surface point in every view, at every resolution. (Skies and
water grow darker by the picture's rows; materials start from the subject's mean brightness.)
`n` pictures of `h w` pixels, sRGB in [0, 1]; shares are in [0, 1].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.looks import (
    along,
    blur,
    cartoon,
    colours,
    luma,
    ramp,
    s_curve,
    smoothstep,
)
from gsedit.teaching.sources import Sources

Pictures = Float[Tensor, "n h w 3"]
Shares = Float[Tensor, "n h w 1"]
Paint = Callable[[Sources], Tensor]

MIDDLE = 0.45  # brightness that a subject's mean is moved toward before it becomes a material
RELIEF = 0.3  # share of a material's shading that comes from the shape alone: texture fades
SKY_FROM, SKY_TO = 4.0, 7.5  # depths, in distances of the subject, between surface and sky


@dataclass(frozen=True)
class Truth:
    """One look."""

    name: str
    scope: Literal["subject", "scene"]
    """A subject's look leaves every pixel outside the subject as it was."""
    paint: Paint
    """Pictures -> whole edited pictures, not clamped."""
    hue_share: float = 1.0
    """How much of a draw's hue it takes: less where a turned hue would be another look."""


@dataclass(frozen=True)
class Draw:
    """How one sample departs from the central truth."""

    gain: float
    """Factor on brightness, 1 = none."""
    hue: float
    """Turn about the grey axis, degrees."""
    amount: float
    """1 = the whole edit, 0 = the original."""

    @classmethod
    def random(cls, generator: torch.Generator) -> Draw:
        """Gain in 0.85..1.15, hue within +-10 degrees, amount in 0.75..1."""
        gain, hue = torch.randn(2, generator=generator).tolist()
        weaker = torch.rand((), generator=generator).item()
        return cls(
            gain=min(max(1 + 0.06 * gain, 0.85), 1.15),
            hue=min(max(5 * hue, -10.0), 10.0),
            amount=1 - 0.25 * weaker,
        )

    def part(self, count: int) -> Draw:
        """The departure of each of `count` looks that together depart by this one."""
        return Draw(self.gain ** (1 / count), self.hue / count, self.amount)


CENTRE = Draw(1.0, 0.0, 1.0)


def edited(sources: Sources, names: Sequence[str], draw: Draw = CENTRE) -> Pictures:
    """The pictures with every look, in [0, 1]: the subject's first, then the scene's."""
    truths = sorted((TRUTHS[name] for name in names), key=lambda truth: truth.scope == "scene")
    for truth in truths:
        sources = sources._replace(image=_applied(truth, sources, draw.part(len(truths))))
    return sources.image


def _applied(truth: Truth, sources: Sources, draw: Draw) -> Pictures:
    goal = truth.paint(sources).clamp(0, 1)
    if draw != CENTRE:
        goal = (turned(goal, draw.hue * truth.hue_share) * draw.gain).clamp(0, 1)
    share = draw.amount * sources.subject if truth.scope == "subject" else draw.amount
    return (sources.image + share * (goal - sources.image)).clamp(0, 1)


def turned(images: Pictures, degrees: float) -> Pictures:
    """Colours turned about the grey axis; greys stay."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    grey, cross = torch.full((3, 3), 1 / 3), torch.tensor([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    rotation = cosine * torch.eye(3) + (1 - cosine) * grey + sine / math.sqrt(3) * cross
    return images @ rotation.T.to(images)


# What a picture offers


def sky(sources: Sources) -> Shares:
    """Where there is no surface."""
    bare = 1 - sources.normal.square().sum(-1, keepdim=True)
    return smoothstep(sources.depth, SKY_FROM, SKY_TO) * bare.clamp(0, 1)


def upward(sources: Sources, low: float, high: float) -> Shares:
    """Faces whose normal's height is above `low`, wholly above `high`."""
    return smoothstep(sources.normal[..., 2:], low, high)


def ground(sources: Sources) -> Shares:
    """Level surfaces that are not the subject."""
    return upward(sources, 0.5, 0.9) * (1 - sources.subject)


def haze(sources: Sources, start: float, density: float) -> Shares:
    """Share of the light lost on the way: 0 up to `start`, 1 - 1/e after another 1/density."""
    return 1 - (-density * (sources.depth - start).clamp_min(0)).exp()


def height(sources: Sources) -> Float[Tensor, "h 1 1"]:
    """1 in the picture's top row, 0 in the lowest."""
    rows = sources.image.shape[-3]
    return torch.linspace(1, 0, rows).to(sources.image)[:, None, None]


def shading(sources: Sources, relief: float = RELIEF) -> Shares:
    """Brightness of the subject with its mean near the middle, and of its shape lit from above."""
    grey = luma(sources.image)
    weight = sources.subject.sum((-3, -2), keepdim=True)
    mean = (sources.subject * grey).sum((-3, -2), keepdim=True) / weight.clamp_min(1e-6)
    mean = torch.where(weight > 0, mean, torch.full_like(mean, MIDDLE)).clamp_min(0.02)
    lit = 0.15 + 0.3 * (1 + sources.normal[..., 2:])
    return (1 - relief) * (grey * (MIDDLE / mean) ** 0.75).clamp(0, 1) + relief * lit


def edges(grey: Shares, reach: float = 0.012) -> Shares:
    """How much brightness changes around a pixel; `reach` is a share of the picture's height."""
    radius = pixels(grey, reach)
    mean = blur(grey, radius)
    return (blur(grey.square(), radius) - mean.square()).clamp_min(1e-8).sqrt()


def pixels(images: Tensor, share: float) -> int:
    """A share of the picture's height, in whole pixels, at least 1."""
    return max(1, round(share * images.shape[-3]))


def mixed(first: Tensor, second: Tensor | str, share: Tensor | float) -> Tensor:
    """From the first toward the second, which may be one colour."""
    if isinstance(second, str):
        second = first.new_tensor(colours(second)[0])
    return first + share * (second - first)


def saturated(images: Tensor, amount: float) -> Tensor:
    grey = luma(images)
    return grey + amount * (images - grey)


# The subject's looks


def solid(codes: str, *, contrast: float = 0.35, gamma: float = 1.0, keep: float = 0.04) -> Paint:
    """A material: the subject's shading becomes its colours, dark to bright."""

    def paint(sources: Sources) -> Tensor:
        shade = s_curve(shading(sources), contrast).clamp(0, 1) ** gamma
        return along(shade, codes) + keep * (sources.image - luma(sources.image))

    return paint


def metal(codes: str) -> Paint:
    """A material that mirrors: a bright sky on upper faces, a dark horizon on upright ones."""

    def paint(sources: Sources) -> Tensor:
        up = sources.normal[..., 2:]
        gleam = (-((up - 0.5) / 0.2).square()).exp()
        horizon = (-((up - 0.02) / 0.14).square()).exp() * sources.normal.square().sum(
            -1, keepdim=True
        )
        shade = s_curve(shading(sources, 0.2), 0.8)
        return along((shade + 0.28 * gleam - 0.14 * horizon).clamp(0, 1), codes)

    return paint


def streaked(codes: str, vein: str, frequency: float, strength: float) -> Paint:
    """A material with lines of another colour, along equal brightness and equal slope."""

    def paint(sources: Sources) -> Tensor:
        shade = shading(sources)
        broad = blur(shade, pixels(shade, 0.02))
        phase = frequency * (1.3 * broad + 0.5 * sources.normal[..., 2:])
        line = (-(torch.sin(torch.pi * phase) / 0.3).square()).exp()
        return mixed(along(s_curve(shade, 0.3), codes), vein, strength * line)

    return paint


def coat(colour: str) -> Paint:
    """Plain paint: the shading times one colour, with a soft shine."""

    def paint(sources: Sources) -> Tensor:
        shade = shading(sources)
        base = shade.new_tensor(colours(colour)[0]) * (0.3 + 1.1 * shade).clamp_max(1.05)
        return base + 0.3 * smoothstep(shade, 0.7, 1.0)

    return paint


def grown(codes: str) -> Paint:
    """Moss: cushions on upper faces, green in the folds, damp dark below."""

    def paint(sources: Sources) -> Tensor:
        shade = shading(sources, 0.15)
        cover = 0.55 + 0.45 * upward(sources, -0.5, 0.3)
        damp = mixed(saturated(sources.image, 0.5) * 0.5, "28301c", 0.4)
        return mixed(damp, along(s_curve(shade, 0.6), codes), cover)

    return paint


# The scene's looks


def snowfall(sources: Sources) -> Tensor:
    grey = luma(sources.image)
    settled = torch.maximum(upward(sources, 0.1, 0.5), haze(sources, 2.0, 0.5))
    cold = mixed(saturated(sources.image, 0.5) * 0.85, "8ca0b8", 0.25)
    white = grey.new_tensor(colours("f4f8ff")[0]) * (0.66 + 0.36 * smoothstep(grey, 0.0, 0.7))
    return mixed(mixed(cold, white, 0.9 * settled), "dce4ee", sky(sources))


def fogged(sources: Sources) -> Tensor:
    lost = 1 - 0.72 * (1 - haze(sources, 0.6, 0.75))
    return mixed(saturated(sources.image, 0.6), "b2b6ba", lost)


def dusty(sources: Sources) -> Tensor:
    lost = 1 - 0.9 * (1 - haze(sources, 0.7, 0.5))
    sand = along(0.25 + 0.75 * luma(sources.image), "2c1808 a06c30 e0a860 f4d8a0")
    settled = mixed(saturated(sources.image, 0.6), sand, 0.5 + 0.4 * ground(sources))
    return mixed(settled, "d89c50", lost)


def sunken(sources: Sources) -> Tensor:
    """Water takes red first, and gives back its own blue-green with distance."""
    lit = 0.75 + 0.5 * upward(sources, -0.2, 0.9)
    filtered = sources.image * sources.image.new_tensor((0.25, 1.0, 1.05)) * lit
    water = along(height(sources), "02303c 04647c 18a0b4")
    return mixed(filtered, water.expand_as(filtered), 1 - 0.75 * (1 - haze(sources, 0.8, 0.5)))


def nightfall(sources: Sources) -> Tensor:
    base = ramp("01030c 081430 1c3868 5078b0 b8d0f0", keep=0.12, contrast=0.5, gamma=1.5)
    dark = along(height(sources), "122448 040818").expand_as(sources.image)
    return mixed(base(sources.image), dark, sky(sources))


def dusk(sources: Sources) -> Tensor:
    """A low sun on upright and bright faces, the violet sky on the others."""
    upright = 1 - sources.normal[..., 2:].square()
    sun = (0.8 * smoothstep(upright, 0.1, 0.9) + 0.9 * luma(sources.image) - 0.3).clamp(0, 1)
    shadow = sources.image * sources.image.new_tensor((0.52, 0.34, 0.52))
    warm = mixed(sources.image, "ffa040", 0.3) * sources.image.new_tensor((1.3, 0.75, 0.36))
    glow = along(height(sources), "ffb040 ff7038 c04868 583070").expand_as(warm)
    lit = mixed(shadow, warm, sun)
    return mixed(mixed(lit, "f08040", 0.5 * haze(sources, 1.2, 0.4)), glow, 0.95 * sky(sources))


def leaves(leaf: str, tint: str, air: str) -> Paint:
    """Greens and the ground turn to a season's leaves, the sky to its air."""

    def paint(sources: Sources) -> Tensor:
        red, green, blue = sources.image.split(1, -1)
        grey = luma(sources.image)
        leafy = smoothstep(green - 0.5 * (red + blue), 0.0, 0.08)
        leafy = torch.maximum(leafy * (1 - sky(sources)), 0.85 * ground(sources))
        tinted = saturated(sources.image, 1.2) * grey.new_tensor(colours(tint)[0])
        turned_leaves = along(s_curve(grey * 1.1, 0.4), leaf)
        return mixed(mixed(tinted, turned_leaves, leafy), air, 0.7 * sky(sources))

    return paint


def rained(sources: Sources) -> Tensor:
    """Grey light; wet ground is dark and mirrors the sky."""
    dull = mixed(saturated(sources.image, 0.3) * 0.62, "405470", 0.3)
    wet = mixed(dull * 0.75, "8490a0", 0.35 * upward(sources, 0.8, 1.0))
    shown = mixed(dull, wet, ground(sources))
    return mixed(mixed(shown, "6c7c94", 0.6 * haze(sources, 1.5, 0.3)), "7888a0", sky(sources))


def pencil(sources: Sources) -> Tensor:
    grey = luma(sources.image)
    around = blur(grey, pixels(grey, 0.02))
    lines = (grey / (around + 0.02)).clamp(0, 1) ** 2.5
    inked = lines - 3.0 * (edges(grey, 0.006) - 0.03).clamp(0, 0.2)
    tone = 0.78 + 0.22 * smoothstep(grey, 0.05, 0.6)
    return along((inked * tone).clamp(0, 1), "202024 fcfcf8")


def washed(sources: Sources) -> Tensor:
    """Watercolour: soft flats that run into paper white, pigment gathered at edges."""
    wash = blur(sources.image, pixels(sources.image, 0.01))
    grey = luma(wash)
    pale = 0.42 + 0.58 * saturated(wash, 2.6).clamp(0, 1)
    pigment = (grey - blur(grey, pixels(grey, 0.03))).clamp(-0.08, 0.08)
    return pale * grey.new_tensor(colours("fff8ea")[0]) + 2.4 * pigment


def drawn(sources: Sources) -> Tensor:
    """Cartoon: flat strong colours within black outlines."""
    flat = cartoon(4, 2.6, 0.7, "ffffff")(blur(sources.image, pixels(sources.image, 0.008)))
    grey = luma(sources.image)
    outline = smoothstep(edges(grey, 0.006), 0.06, 0.14)
    return flat.clamp(0, 1) * (1 - 0.95 * outline)


def blueprint(sources: Sources) -> Tensor:
    grey = luma(sources.image)
    lines = smoothstep(edges(grey, 0.006), 0.04, 0.14)
    return mixed(along(0.6 * grey, "0a2c80 1c50b8 3c74cc"), "f0f8ff", 0.95 * lines)


def posterised(sources: Sources) -> Tensor:
    """Pop art: four printed colours."""
    grey = luma(blur(sources.image, pixels(sources.image, 0.004)))
    stops = colours("10285c e0202c f8c020 fff4d0")
    image = grey.new_tensor(stops[0]).expand_as(sources.image)
    for stop, threshold in zip(stops[1:], (0.28, 0.48, 0.7)):
        share = smoothstep(grey, threshold - 0.04, threshold + 0.04)
        image = mixed(image, grey.new_tensor(stop), share)
    return image


def polaroid(sources: Sources) -> Tensor:
    """A faded print: lifted violet blacks, peach whites, weak colours."""
    faded = along(luma(sources.image), "684c68 c0908c fce0b8")
    return mixed(faded, sources.image, 0.25)


def toned(factors: tuple[float, float, float]) -> Paint:
    return lambda sources: sources.image * sources.image.new_tensor(factors)


def _on_image(change: Callable[[Tensor], Tensor]) -> Paint:
    return lambda sources: change(sources.image)


_SUBJECT: dict[str, tuple[Paint, float]] = {
    "bronze": (metal("100804 4c2c10 8c5c24 c89850 f8e0a8"), 0.6),
    "gold": (metal("3c1c00 a86800 f0b010 ffe058 fffce0"), 0.5),
    "silver": (metal("101218 4c525c 98a0aa d4dae2 ffffff"), 0.0),
    "verdigris": (solid("0c3038 1c6874 38a0a4 78ccc4 c0ece0"), 0.6),
    "rust": (streaked("1c0a06 6c2810 b04c18 d0743c e8b080", "401c10", 4.0, 0.6), 0.6),
    "marble": (streaked("68707c b0b4bc e4e4e2 f8f8f6 ffffff", "404450", 3.0, 0.7), 0.0),
    "sandstone": (solid("58401c a07c48 d4b47c ecd4a4 fcf0d0"), 0.5),
    "slate": (solid("080c12 202a36 3c4a5a 5c6c7e 90a0b0", contrast=0.5), 0.0),
    "wood": (streaked("2c1804 684010 a07430 c8a058 e8cc90", "4c2408", 7.0, 0.6), 0.5),
    "terracotta": (solid("44100c 943420 c85238 e08468 f4c4b0"), 0.5),
    "chocolate": (solid("140804 3c180c 623018 8c5030 d8a480", contrast=0.5), 0.4),
    "porcelain": (solid("8c4868 dc88ac f8b0cc ffdcea ffffff"), 0.2),
    "jade": (solid("083c20 3c9c58 80d090 bcecbc f4fff0"), 0.5),
    "ice": (metal("0c3c6c 3490d8 80ccf8 c8f0ff ffffff"), 0.3),
    "lava": (streaked("0c0404 200806 481008 a02808 f08020", "ffb020", 2.5, 1.0), 0.4),
    "moss": (grown("0c1404 2c4010 546c1c 84983c b4c468"), 0.5),
    "red": (coat("e01018"), 0.4),
    "orange": (coat("ff8600"), 0.3),
    "yellow": (coat("fff010"), 0.3),
    "green": (coat("18b428"), 0.6),
    "blue": (coat("1438e8"), 0.6),
    "purple": (coat("7818c0"), 0.5),
    "pink": (coat("ff50b0"), 0.5),
    "white": (coat("ffffff"), 0.0),
    "black": (solid("000001 030305 0a0a0d 1c1c20 686870", contrast=0.6), 0.0),
}
_SCENE: dict[str, tuple[Paint, float]] = {
    "snow": (snowfall, 0.0),
    "fog": (fogged, 0.0),
    "rain": (rained, 0.3),
    "desert": (dusty, 0.5),
    "underwater": (sunken, 0.6),
    "night": (nightfall, 0.6),
    "sunset": (dusk, 0.5),
    "autumn": (leaves("3c1004 b84c08 f09020 ffd060", "ffe0b0", "f0dcb8"), 0.5),
    "spring": (leaves("083004 208810 58c828 b8f060", "e8fff0", "58b0f8"), 0.5),
    "sketch": (pencil, 0.0),
    "watercolor": (washed, 0.5),
    "cartoon": (drawn, 0.3),
    "pop-art": (posterised, 0.4),
    "blueprint": (blueprint, 0.4),
    "black-and-white": (_on_image(ramp("000000 ffffff", keep=0.0, contrast=0.9, gamma=1.2)), 0.0),
    "sepia": (_on_image(ramp("1c1008 644830 ac8c64 e0c8a0 fff4dc", keep=0.0, gamma=1.1)), 0.3),
    "neon": (_on_image(ramp("060018 4c0c90 e018b0 ff70d0 80f8ff", keep=0.4, contrast=0.7)), 0.4),
    "thermal": (
        _on_image(ramp("080060 0070f0 20e080 f8e820 f01808", keep=0.0, contrast=0.3, gamma=1.0)),
        0.4,
    ),
    "negative": (_on_image(lambda image: 1 - image), 0.5),
    "polaroid": (polaroid, 0.3),
    "warmer": (toned((1.25, 0.98, 0.55)), 0.3),
    "cooler": (toned((0.6, 0.95, 1.35)), 0.3),
    "brighter": (_on_image(lambda image: 1.05 * (1 - (1 - image) ** 2)), 0.3),
    "darker": (_on_image(lambda image: 0.42 * image), 0.3),
    "high-contrast": (_on_image(lambda image: saturated(0.45 + 2.6 * (image - 0.45), 1.2)), 0.3),
    "vivid": (_on_image(lambda image: saturated(image, 2.8)), 0.3),
}

TRUTHS: dict[str, Truth] = {
    **{name: Truth(name, "subject", *entry) for name, entry in _SUBJECT.items()},
    **{name: Truth(name, "scene", *entry) for name, entry in _SCENE.items()},
}
"""By name: what happens to the subject, then what happens to the scene."""
