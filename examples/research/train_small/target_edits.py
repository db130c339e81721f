"""The target edits that the small editor is trained on: what a picture becomes, by look.

A look is a smooth function of a pixel's color, normal and depth: nearly one color for a surface
point in every view, at every resolution. `n` pictures of `h w` pixels, sRGB in [0, 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from gsedit.datasets.image_ops import rotate_hue
from gsedit.editors.looks.color_maps import ramp
from research.train_small.look_functions import (
    LookFunction,
    blueprint,
    desert,
    fog,
    metal,
    mossy,
    night,
    on_image,
    outlined_cartoon,
    painted,
    polaroid,
    pop_art,
    rain,
    saturate,
    season,
    sketch,
    snow,
    solid,
    streaked,
    sunset,
    toned,
    underwater,
    watercolor,
)
from research.train_small.sources import Pictures, Sources


@dataclass(frozen=True)
class TargetEdit:
    """Target edit of one look."""

    name: str
    scope: Literal["subject", "scene"]
    """A subject's look leaves every pixel outside the subject as it was."""
    apply: LookFunction
    """Pictures -> whole edited pictures, not clamped."""
    hue_share: float = 1.0
    """Share of a variation's hue that is used: less where a rotated hue would be another look."""


@dataclass(frozen=True)
class Variation:
    """How one sample differs from the look's standard edit: augmentation of the targets."""

    gain: float
    """Factor on brightness; 1 = none."""
    hue: float
    """Rotation about the grey axis, degrees."""
    amount: float
    """1 = the whole edit, 0 = the unedited picture."""

    @classmethod
    def random(cls, generator: torch.Generator) -> Variation:
        """Gain in 0.85..1.15, hue within +-10 degrees, amount in 0.75..1."""
        gain, hue = torch.randn(2, generator=generator).tolist()
        weaker = torch.rand((), generator=generator).item()
        return cls(
            gain=min(max(1 + 0.06 * gain, 0.85), 1.15),
            hue=min(max(5 * hue, -10.0), 10.0),
            amount=1 - 0.25 * weaker,
        )

    def part(self, count: int) -> Variation:
        """The variation of each of `count` looks that together make up this one."""
        return Variation(self.gain ** (1 / count), self.hue / count, self.amount)


NO_VARIATION = Variation(1.0, 0.0, 1.0)


def target_images(
    sources: Sources, names: Sequence[str], variation: Variation = NO_VARIATION
) -> Pictures:
    """The pictures with every look, in [0, 1]: the subject's is applied first, then the scene's."""
    edits = sorted((TARGET_EDITS[name] for name in names), key=lambda edit: edit.scope == "scene")
    for edit in edits:
        sources = sources._replace(image=_applied(edit, sources, variation.part(len(edits))))
    return sources.image


def _applied(edit: TargetEdit, sources: Sources, variation: Variation) -> Pictures:
    goal = edit.apply(sources).clamp(0, 1)
    if variation != NO_VARIATION:
        goal = (rotate_hue(goal, variation.hue * edit.hue_share) * variation.gain).clamp(0, 1)
    amount = variation.amount
    share = amount * sources.subject if edit.scope == "subject" else amount
    return (sources.image + share * (goal - sources.image)).clamp(0, 1)


_SUBJECT: dict[str, tuple[LookFunction, float]] = {
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
    "moss": (mossy("0c1404 2c4010 546c1c 84983c b4c468"), 0.5),
    "red": (painted("e01018"), 0.4),
    "orange": (painted("ff8600"), 0.3),
    "yellow": (painted("fff010"), 0.3),
    "green": (painted("18b428"), 0.6),
    "blue": (painted("1438e8"), 0.6),
    "purple": (painted("7818c0"), 0.5),
    "pink": (painted("ff50b0"), 0.5),
    "white": (painted("ffffff"), 0.0),
    "black": (solid("000001 030305 0a0a0d 1c1c20 686870", contrast=0.6), 0.0),
}
_SCENE: dict[str, tuple[LookFunction, float]] = {
    "snow": (snow, 0.0),
    "fog": (fog, 0.0),
    "rain": (rain, 0.3),
    "desert": (desert, 0.5),
    "underwater": (underwater, 0.6),
    "night": (night, 0.6),
    "sunset": (sunset, 0.5),
    "autumn": (season("3c1004 b84c08 f09020 ffd060", "ffe0b0", "f0dcb8"), 0.5),
    "spring": (season("083004 208810 58c828 b8f060", "e8fff0", "58b0f8"), 0.5),
    "sketch": (sketch, 0.0),
    "watercolor": (watercolor, 0.5),
    "cartoon": (outlined_cartoon, 0.3),
    "pop-art": (pop_art, 0.4),
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
    "high-contrast": (on_image(lambda image: saturate(0.45 + 2.6 * (image - 0.45), 1.2)), 0.3),
    "vivid": (on_image(lambda image: saturate(image, 2.8)), 0.3),
}

TARGET_EDITS: dict[str, TargetEdit] = {
    **{name: TargetEdit(name, "subject", *entry) for name, entry in _SUBJECT.items()},
    **{name: TargetEdit(name, "scene", *entry) for name, entry in _SCENE.items()},
}
"""By name of the look: those of the subject, then those of the scene."""
