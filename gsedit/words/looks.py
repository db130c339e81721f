"""The looks that the editor `small` was trained on, and the wording in which it is asked for each.

Subject looks change the object alone, scene looks the whole picture. The wordings are prompts of
its training: between those of one look its edits differ by 0.1 dB to the target edit (14 looks,
four to six prompts each), so one is as good as another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Scope = Literal["subject", "scene"]


@dataclass(frozen=True)
class Look:
    """One look that can be asked for."""

    name: str
    scope: Scope
    wording: str
    """Wording that the editor is given for this look."""


def _looks(scope: Scope, wordings: dict[str, str]) -> dict[str, Look]:
    return {name: Look(name, scope, wording) for name, wording in wordings.items()}


LOOKS: dict[str, Look] = {
    **_looks(
        "subject",
        {
            "bronze": "turn it into a bronze statue",
            "gold": "turn it into a golden statue",
            "silver": "turn it into a silver statue",
            "verdigris": "turn it into a verdigris statue",
            "rust": "turn it into a rusty statue",
            "marble": "turn it into a marble statue",
            "sandstone": "turn it into a sandstone statue",
            "slate": "turn it into a slate statue",
            "wood": "turn it into a wooden statue",
            "terracotta": "turn it into a terracotta statue",
            "chocolate": "turn it into a chocolate statue",
            "porcelain": "turn it into a pink porcelain statue",
            "jade": "turn it into a jade statue",
            "ice": "turn it into an icy statue",
            "lava": "turn it into a lava statue",
            "moss": "cover it in moss",
            "red": "paint it red",
            "orange": "paint it orange",
            "yellow": "paint it yellow",
            "green": "paint it green",
            "blue": "paint it blue",
            "purple": "paint it purple",
            "pink": "paint it pink",
            "white": "paint it white",
            "black": "paint it black",
        },
    ),
    **_looks(
        "scene",
        {
            "snow": "make it snow",
            "fog": "add fog",
            "rain": "make it rain",
            "desert": "make it look like a desert",
            "underwater": "put it underwater",
            "night": "make it night",
            "sunset": "make it sunset",
            "autumn": "make it autumn",
            "spring": "make it spring",
            "sketch": "draw it in pencil",
            "watercolor": "make it a watercolor",
            "cartoon": "make it a cartoon",
            "pop-art": "make it pop art",
            "blueprint": "make it a blueprint",
            "black-and-white": "make it black and white",
            "sepia": "make it sepia",
            "neon": "make it neon",
            "thermal": "make a thermal image of it",
            "negative": "invert the colors",
            "polaroid": "make a polaroid of it",
            "warmer": "make the colors warmer",
            "cooler": "make the colors cooler",
            "brighter": "make everything brighter",
            "darker": "make everything darker",
            "high-contrast": "increase the contrast",
            "vivid": "boost the saturation",
        },
    ),
}
"""All looks by their names."""
