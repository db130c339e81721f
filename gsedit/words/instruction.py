"""Changes that a sentence asks for, in order, or why it is refused. Loads no torch."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal

Target = Literal["subject", "background", "scene"]
Kind = Literal["material", "paint", "tone", "light", "look"]


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
    """Signed share for tone: -0.3 is 30 % less; for hue a share of the full circle."""
    route: str
    """Way that does the change: "tone", "paint", or "small" for the 2D editor."""

    def __str__(self) -> str:
        named = f"{self.name} {self.amount:+.0%}" if self.amount is not None else self.name
        return f"{self.target}: {self.kind} {named}" + (f" {self.color}" if self.color else "")


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

    def as_json(self) -> str:
        """One line of JSON with the keys known, why and changes."""
        changes = [asdict(change) for change in self.changes]
        return json.dumps({"known": self.known, "why": self.why, "changes": changes})

    def __str__(self) -> str:
        return "; ".join(map(str, self.changes)) if self.known else self.why
