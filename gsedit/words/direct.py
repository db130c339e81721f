"""Routes of changes, by the names that a sentence is read with. Loads no torch."""

from __future__ import annotations

from dataclasses import replace

from gsedit.words.instruction import Change
from gsedit.words.lexicon import names, styles
from gsedit.words.scan import scanned

LIGHTS, SCENERIES = names("light"), names("scenery")
"""Names of the lights in gsedit.change.light.table, and of weather, seasons and drawings in
gsedit.change.scenery.table."""
LIKE = "the given picture"
"""Name of the style of a picture that is given beside the sentence."""


def light_of(name: str) -> str:
    """The light that a name such as "sunset from the left" begins with; the name without one."""
    words = name.split()
    starts = (" ".join(words[:end]) for end in range(len(words), 0, -1))
    return next((start for start in starts if start in LIGHTS), name)


def routed(change: Change) -> Change:
    """A change with the route that does it; that of an editor of any sentence where none here does.

    gsedit.change.materials.table has every material of the lexicon.
    """
    if change.kind in ("tone", "paint", "material"):
        return replace(change, route=change.kind)
    if change.kind in ("object", "growth"):
        return replace(change, route="object")
    if change.kind == "light" and light_of(change.name) in LIGHTS:
        return replace(change, route="light")
    if change.kind == "look" and change.name in SCENERIES:
        return replace(change, route="scenery")
    drawn = change.kind == "look" and (change.name == LIKE or change.name in styles())
    return replace(change, route="style" if drawn else "pix2pix")


def material_of(name: str) -> str:
    """Material of the table that a name such as "polished black granite" means; "" for none."""
    plain = scanned(name.split(" with ")[0])
    return next((word.value for word in reversed(plain) if word.kind in ("material", "look")), "")
