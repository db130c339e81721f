"""The looks that the editor `small` was trained on, the changes that each does, and routes.

Subject looks change the object alone, scene looks the whole picture. The wordings are prompts of
its training: between those of one look its edits differ by 0.1 dB to the target edit (14 looks,
four to six prompts each), so one is as good as another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from gsedit.words import colors, lexicon
from gsedit.words.direct import direct_route
from gsedit.words.instruction import Change
from gsedit.words.scan import scanned

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
NAMES = {
    "moonlight": "night", "dusk": "sunset", "blue hour": "night", "golden hour": "sunset",
    "sunrise": "sunset", "underwater light": "underwater", "candlelight": "sunset",
    "storm": "rain", "impressionist": "watercolor", "frost": "snow", "wet": "rain",
    "stone": "sandstone",
}  # fmt: skip
"""Looks of `small` for changes of another name."""
TONES = {
    ("warmth", 1): "warmer", ("warmth", -1): "cooler", ("brightness", 1): "brighter",
    ("brightness", -1): "darker", ("contrast", 1): "high-contrast", ("saturation", 1): "vivid",
    ("grayscale", 1): "black-and-white", ("sepia", 1): "sepia", ("negative", 1): "negative",
}  # fmt: skip
"""Looks of `small` by tone and sign."""
COLORS = {"porcelain": "#f5a0c0"}
"""Colors of looks of `small` that are not their material's own."""
CLOSE = 25.0
"""Largest CIE 1976 difference of a color from that of the look that stands for it."""


def look_of(change: Change) -> Look | None:
    """Look of the editor `small` that does a change; None where none of its looks fits."""
    if change.route == "object":
        return None
    if change.kind == "tone":
        name = TONES.get((change.name, -1 if (change.amount or 0) < 0 else 1))
    elif change.kind == "paint":
        near = sorted((_apart(change.color, each), each) for each in colors.PLAIN if each in LOOKS)
        name = near[0][1] if near[0][0] < CLOSE else None
    else:
        scope = "subject" if change.kind == "material" else "scene"
        looks = [LOOKS[each] for each in _names(change) if each in LOOKS]
        name = next((look.name for look in looks if look.scope == scope), None)
    if change.kind == "material" and name and not _is_close(change, name):
        return None
    return LOOKS.get(name) if name else None


def routed(change: Change) -> Change:
    """A change with the route that does it."""
    fits = look_of(change)
    if change.kind in ("tone", "paint"):
        return replace(change, route=change.kind)
    if route := direct_route(change):
        return replace(change, route=route)
    return replace(change, route="small" if fits else "pix2pix")


def material_of(name: str) -> str:
    """Material of the table that a name such as "polished black granite" means; "" for none."""
    plain = scanned(name.split(" with ")[0])
    return next((word.value for word in reversed(plain) if word.kind in ("material", "look")), "")


def _names(change: Change) -> list[str]:
    """Names under which `small` may know a material, light or look."""
    if change.kind == "material":
        plain = change.name.split(" with ")[0]
        each = [plain, plain.split()[-1]]
    else:
        each = [change.name, change.name.split(" from ")[0], change.name.split()[0]]
    return [NAMES.get(one, one) for one in each]


def _is_close(change: Change, look: str) -> bool:
    """Whether the color that a material is asked in is the look's own."""
    base = COLORS.get(look) or lexicon.materials().get(look)
    if not change.color or not base:
        return look not in COLORS
    return colors.distance(change.color, base) < CLOSE


def _apart(color: str | None, look: str) -> float:
    """Difference of a color from that of a paint."""
    own = colors.named(look)
    return colors.distance(color, own) if color and own else float("inf")
