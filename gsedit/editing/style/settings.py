"""Settings of a style, without torch: the help of the command reads them."""

from __future__ import annotations

from dataclasses import dataclass, field

from gsedit.errors import UsageError
from rasterizer.numerics import AUTO, Execution


@dataclass(frozen=True)
class StyleSettings:
    """How the style is brought over. Raises UsageError for a value out of range."""

    strength: float = field(default=1.0, metadata={"flag": "--strength"})
    """How far colors go towards the picture's, and weight of the texture: 0 to 1."""
    steps: int = field(default=100, metadata={"flag": "--steps"})
    """Steps of the texture; 0 for colors alone."""
    views: int = field(default=12, metadata={"flag": "--views"})
    """Most views that are looked at, evenly spaced."""
    content: float = field(default=10.0, metadata={"flag": "--content"})
    """Weight of what the pictures show, against the style."""
    rate: float = 0.025
    """Learning rate of the colors."""
    execution: Execution = AUTO

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UsageError(f"strength {self.strength:g}: give a number from 0 to 1")
        if self.steps < 0 or self.views < 1:
            raise UsageError(f"{self.steps} steps on {self.views} views: give 0 or more, 1 or more")
        if not (self.content >= 0 and self.rate > 0):
            raise UsageError("the weight of the content is 0 or more, the learning rate above 0")
