"""The edits that the small model learns: what a picture must become, by the name of the look.

A look is a smooth function of a pixel's colour, normal and depth: nearly one colour for a surface
point in every view, at every resolution. `n` pictures of `h w` pixels, sRGB in [0, 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.looks import ramp
from gsedit.views.image_ops import rotate_hue
from train_small.paints import (
    Paint,
    blueprint,
    coat,
    drawn,
    dusk,
    dusty,
    fogged,
    grown,
    leaves,
    metal,
    nightfall,
    on_image,
    pencil,
    polaroid,
    posterised,
    rained,
    saturated,
    snowfall,
    solid,
    streaked,
    sunken,
    toned,
    washed,
)
from train_small.sources import Sources

Pictures = Float[Tensor, "n h w 3"]


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
        goal = (rotate_hue(goal, draw.hue * truth.hue_share) * draw.gain).clamp(0, 1)
    share = draw.amount * sources.subject if truth.scope == "subject" else draw.amount
    return (sources.image + share * (goal - sources.image)).clamp(0, 1)


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
    "black-and-white": (on_image(ramp("000000 ffffff", keep=0.0, contrast=0.9, gamma=1.2)), 0.0),
    "sepia": (on_image(ramp("1c1008 644830 ac8c64 e0c8a0 fff4dc", keep=0.0, gamma=1.1)), 0.3),
    "neon": (on_image(ramp("060018 4c0c90 e018b0 ff70d0 80f8ff", keep=0.4, contrast=0.7)), 0.4),
    "thermal": (
        on_image(ramp("080060 0070f0 20e080 f8e820 f01808", keep=0.0, contrast=0.3, gamma=1.0)),
        0.4,
    ),
    "negative": (on_image(lambda image: 1 - image), 0.5),
    "polaroid": (polaroid, 0.3),
    "warmer": (toned((1.25, 0.98, 0.55)), 0.3),
    "cooler": (toned((0.6, 0.95, 1.35)), 0.3),
    "brighter": (on_image(lambda image: 1.05 * (1 - (1 - image) ** 2)), 0.3),
    "darker": (on_image(lambda image: 0.42 * image), 0.3),
    "high-contrast": (on_image(lambda image: saturated(0.45 + 2.6 * (image - 0.45), 1.2)), 0.3),
    "vivid": (on_image(lambda image: saturated(image, 2.8)), 0.3),
}

TRUTHS: dict[str, Truth] = {
    **{name: Truth(name, "subject", *entry) for name, entry in _SUBJECT.items()},
    **{name: Truth(name, "scene", *entry) for name, entry in _SCENE.items()},
}
"""By name: what happens to the subject, then what happens to the scene."""
