"""Changes that are done on the Gaussians themselves, by the names that a sentence is read with."""

from __future__ import annotations

from gsedit.words.instruction import Change

LIGHTS = frozenset(
    (
        "night", "moonlight", "dusk", "blue hour", "sunset", "golden hour", "sunrise", "sunny",
        "noon", "daylight", "cloudy", "storm", "fog", "lamp", "candlelight", "studio light",
        "backlight", "neon", "spotlight", "underwater light",
    )
)  # fmt: skip
"""Names of the lights in gsedit.light.named."""
SCENERIES = frozenset(
    (
        "snow", "frost", "rain", "wet", "desert", "autumn", "spring", "summer", "underwater",
        "sketch", "watercolor",
    )
)  # fmt: skip
"""Names of weather, seasons and drawings in gsedit.scenery.named."""
UNCLEAR = frozenset(("cartoon", "pop-art", "blueprint", "thermal", "polaroid"))
"""Looks that only `small` draws, which are refused unless it is asked for by name."""
ROUTES = {"light": ("light", LIGHTS), "look": ("scenery", SCENERIES)}
"""Route and names by kind of change."""


def light_of(name: str) -> str:
    """The light that a name such as "sunset from the left" begins with; the name without one."""
    words = name.split()
    starts = (" ".join(words[:end]) for end in range(len(words), 0, -1))
    return next((start for start in starts if start in LIGHTS), name)


def direct_route(change: Change) -> str | None:
    """The route that does a change on the Gaussians; None where none does.

    gsedit.materials.table has every material of the lexicon.
    """
    if change.kind == "material":
        return "material"
    route, names = ROUTES.get(change.kind, ("", frozenset()))
    return route if light_of(change.name) in names else None
