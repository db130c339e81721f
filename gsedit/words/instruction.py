"""Changes that a sentence asks for, in order, or why it is refused. Loads no torch."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass
from typing import Literal

Target = Literal["subject", "background", "scene"]
Kind = Literal["material", "paint", "tone", "light", "look"]
MOST = {"tone": 5.0, "light": 2.0}
"""Largest shares that a tone and a light's strength grow by: colors six times as bright are white
or black nearly everywhere."""


@dataclass(frozen=True)
class Change:
    """One change of one part of a scene."""

    target: Target
    """Part that changes: the scene's subject, all but the subject, or both."""
    kind: Kind
    name: str
    """Name of the material, paint, light or look; for tone brightness, contrast, saturation,
    warmth, hue, grayscale, sepia or negative."""
    color: str | None
    """Color as "#rrggbb"; None where the name alone says it. For hue the color to turn to."""
    amount: float | None
    """Signed share for tone: -0.3 is 30 % less; for hue a share of the full circle; for grayscale,
    sepia and negative the share in which they are mixed in, None for all; for light the share that
    it is stronger than usual."""
    route: str
    """Way that does the change: "tone", "paint", "material", "light" or "scenery"; or the 2D
    editor "small" or "pix2pix"."""

    def __str__(self) -> str:
        part = "the whole scene" if self.target == "scene" else f"the {self.target}"
        color = f" ({self.color})" if self.color and self.color != self.name else ""
        match self.kind:
            case "tone":
                return f"{part} {_tone(self)}"
            case "paint":
                mixed = "a color " * self.name.startswith("between ")
                return f"{part} painted {mixed}{self.name}{color}"
            case "material":
                return f"{part} made of {self.name}{color}"
        name = re.sub(r"(?<!from) (above|below)$", r" from \1", self.name)
        more = "weaker" if (self.amount or 0) < 0 else "stronger"
        amount = "" if self.amount is None else f", {abs(self.amount):.0%} {more}"
        return f"{part} with the {self.kind}: {name}{color}{amount}".replace("%", " %")


MORE = {
    "brightness": ("brighter", "darker"), "warmth": ("warmer", "cooler"),
    "contrast": ("more contrast", "less contrast"),
    "saturation": ("more saturation", "less saturation"),
}  # fmt: skip
"""Words for more and for less of a tone."""


def _tone(change: Change) -> str:
    """A tone in words: "20 % darker"."""
    amount = change.amount or 0.0
    if change.name in MORE:
        words = MORE[change.name][amount < 0]
        return f"{'with ' * (' ' in words)}{abs(amount):.0%} {words}".replace("%", " %")
    if change.name == "hue":
        where = f"{'away from' if amount < 0 else 'toward'} {change.color}" if change.color else ""
        return f"with its hue turned {abs(amount) * 360:.0f} degrees {where}".rstrip()
    share = "" if change.amount is None else f"{amount:.0%} ".replace("%", " %")
    return f"in {share}{change.name}"


@dataclass(frozen=True)
class Instruction:
    """A sentence as it was read: what changes, or why nothing does."""

    text: str
    known: bool
    """Whether the changes are what the sentence asks for."""
    why: str
    """Reason and nearest thing that can be done, where it is refused; else how it was read."""
    changes: tuple[Change, ...]
    """In the order in which they are done; empty where the sentence is refused."""
    refusal: str = ""
    """Kind of refusal, such as "negation"; "" where it is known."""

    def as_json(self) -> str:
        """One line of JSON with the keys known, why and changes."""
        changes = [asdict(change) for change in self.changes]
        return json.dumps({"known": self.known, "why": self.why, "changes": changes})

    def __str__(self) -> str:
        return "; ".join(map(str, self.changes)) if self.known else self.why
