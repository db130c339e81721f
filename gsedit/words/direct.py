"""Changes that are done on the Gaussians themselves, by the names that a sentence is read with."""

from __future__ import annotations

from gsedit.words.instruction import Change
from gsedit.words.lexicon import names

LIGHTS, SCENERIES = names("light"), names("scenery")
"""Names of the lights in gsedit.change.light.table, and of weather, seasons and drawings in
gsedit.change.scenery.table."""
UNCLEAR = names("unclear")
"""Looks that only `small` draws, which are refused unless it is asked for by name."""


def light_of(name: str) -> str:
    """The light that a name such as "sunset from the left" begins with; the name without one."""
    words = name.split()
    starts = (" ".join(words[:end]) for end in range(len(words), 0, -1))
    return next((start for start in starts if start in LIGHTS), name)


def direct_route(change: Change) -> str | None:
    """The route that does a change on the Gaussians; None where none does.

    gsedit.change.materials.table has every material of the lexicon.
    """
    if change.kind == "light" and light_of(change.name) in LIGHTS:
        return "light"
    if change.kind == "look" and change.name in SCENERIES:
        return "scenery"
    return "material" if change.kind == "material" else None
