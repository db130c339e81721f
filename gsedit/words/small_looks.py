"""Looks of the editor `small` as changes, and back; the route of a change."""

from __future__ import annotations

from dataclasses import replace

from gsedit.words import colors, lexicon
from gsedit.words.direct import direct_route
from gsedit.words.instruction import Change
from gsedit.words.looks import LOOKS, Look
from gsedit.words.scan import scanned

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
LIGHTS = frozenset(("fog", "night", "sunset", "neon"))
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


def change_of_look(look: Look) -> Change:
    """Change that a look of `small` is; a tone is a look here, which has no amount."""
    if look.scope == "scene":
        kind = "light" if look.name in LIGHTS else "look"
        return routed(Change("scene", kind, look.name, None, None, "small"))
    if look.name in colors.PLAIN:
        return Change("subject", "paint", look.name, colors.named(look.name), None, "paint")
    return Change("subject", "material", look.name, COLORS.get(look.name), None, "material")


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
