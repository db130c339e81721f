"""Looks of the editor `small` as changes, and back."""

from __future__ import annotations

from gsedit.words import colors, lexicon, materials
from gsedit.words.instruction import Change
from gsedit.words.looks import LOOKS, Look
from gsedit.words.scan import scanned
from gsedit.words.tokens import words


def look_of(change: Change) -> Look | None:
    """Look of the editor `small` that does a change; None where none of its looks fits."""
    table = {
        "material": materials.SMALL_MATERIALS,
        "light": lexicon.SMALL_LIGHTS,
        "look": lexicon.SMALL_LOOKS,
    }
    names = table.get(change.kind, {})
    name = names.get(change.name) or names.get(change.name.split()[-1])
    if change.kind == "material" and not name:
        name = names.get(material_of(change.name))
    return LOOKS[name] if name else None


def material_of(name: str) -> str:
    """Material of the table that a name such as "polished black granite" means; "" for none."""
    found = [word.value for word in scanned(words(name)) if word.kind == "material"]
    return found[-1 if "with" not in name else 0] if found else ""


def tone_change(name: str, amount: float | None) -> Change:
    """Change of a tone of the whole scene."""
    return Change("scene", "tone", name, None, amount, "tone")


def change_of_look(look: Look) -> Change:
    """Change that a look of `small` is."""
    signs = {
        "warmer": ("warmth", 0.25),
        "cooler": ("warmth", -0.25),
        "brighter": ("brightness", 0.2),
        "darker": ("brightness", -0.2),
        "high-contrast": ("contrast", 0.25),
        "vivid": ("saturation", 0.3),
        "black-and-white": ("grayscale", None),
        "sepia": ("sepia", None),
        "negative": ("negative", None),
    }
    if look.name in signs:
        return tone_change(*signs[look.name])
    if look.name in lexicon.SMALL_LIGHTS:
        return Change("scene", "light", look.name, None, None, "small")
    if look.scope == "scene":
        return Change("scene", "look", look.name, None, None, "small")
    if look.name in colors.PLAIN:
        return Change("subject", "paint", look.name, colors.named(look.name), None, "paint")
    return Change(
        "subject", "material", look.name, materials.MATERIALS.get(look.name), None, "small"
    )
