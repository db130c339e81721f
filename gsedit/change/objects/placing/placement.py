"""How an object is to be placed: its size, its turn, its place. `n` Gaussians."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal, get_args

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import Said, UsageError

Side = Literal["left", "right", "front", "behind", "on", "beside"]
Number = float | int
Triple = tuple[Number, Number, Number]
LARGEST = 1000.0
"""Factor of a size, or its inverse, beyond which the object is a dot, or all that is seen."""


@dataclass(frozen=True, eq=False)
class RelativePlace:
    """A side of a reference object, as the cameras see it."""

    side: Side = "beside"
    """A side of it; "on" its top, at the middle, or at a free place near the middle of what is much
    wider than the object; "beside": at the nearest free place."""
    of: Bool[Tensor, " n"] | None = None
    """Its Gaussians in the scene before; None: the placed object where it was."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Way of an object to its place: scaled and turned, put at `to`, moved by `offset`, set down.

    Directions are as the cameras see them: towards the right, back (away from them), and up.
    """

    scale: float | int = 1.0
    """Factor of its lengths, above 0, about the point where it touches what carries it."""
    turn: float | int = 0.0
    """Degrees about the upward direction, counterclockwise as seen from above."""
    offset: Triple = (0.0, 0.0, 0.0)
    """Way to the right, back and up; left, forward and down are negative."""
    unit: float | int | None = None
    """World units of 1 in the offset; None: the object's height after scaling."""
    to: Triple | RelativePlace | None = None
    """World point that it stands at, or below; or a place beside something. None: where it is."""
    copy: bool = False
    """Whether the original stays where it is."""

    @property
    def moves(self) -> bool:
        """Whether it is to stand at another place than it does."""
        return self.to is not None or any(self.offset[:2])

    @property
    def is_nothing(self) -> bool:
        """Whether everything stays as it is."""
        return self.only_rises and not self.offset[2]

    @property
    def only_rises(self) -> bool:
        """Whether it goes up or down, at most."""
        return not (self.moves or self.copy) and self.scale == 1 and self.turn % 360 == 0


def check_placement(placement: Placement, inside: Bool[Tensor, " n"], count: int) -> None:
    """Raise UsageError for an object or values that nothing can be placed by, in a scene of `count`
    Gaussians."""
    check_region(inside, count)
    away = placement.moves or placement.offset[2]
    if away and not placement.copy and bool(inside.all()):
        raise UsageError(
            "the object is the whole scene, which leaves nothing to place it on: name a part of "
            "it, or move the scene with gsedit transform"
        )
    numbers = [placement.turn, *placement.offset]
    numbers += [] if placement.unit is None else [placement.unit]
    if not 1 / LARGEST <= placement.scale <= LARGEST:
        raise UsageError(
            f"a size of {placement.scale:g} times: give a factor from {1 / LARGEST:g} to "
            f"{LARGEST:g}, as 2 for twice as big"
        )
    if not all(map(isfinite, numbers)) or placement.unit == 0:
        raise UsageError("a turn, an offset and its unit are finite numbers: give such")
    check_target(placement.to, count)


def check_target(to: Triple | RelativePlace | None, count: int) -> None:
    """Raise UsageError for a place that is none in a scene of `count` Gaussians."""
    if isinstance(to, RelativePlace):
        if to.side not in get_args(Side):
            raise UsageError(f"side '{to.side}': one of {', '.join(get_args(Side))}")
        if to.of is not None:
            check_region(to.of, count, "the object to place it by")
    elif to is not None and not (len(to) == 3 and all(map(isfinite, to))):
        raise UsageError(f"place {tuple(to)}: give a point of three finite world coordinates")


def check_region(inside: Bool[Tensor, " n"], count: int, what: str = "the object") -> None:
    """Raise UsageError for flags of another scene, or that hold nothing."""
    if inside.shape != (count,) or inside.dtype != torch.bool:
        flags = f"{tuple(inside.shape)} flags for {count:,} Gaussians"
        raise UsageError(Said(f"{what}: {flags}", "look"))
    if not bool(inside.any()):
        raise UsageError(Said(f"{what} has no Gaussian", "look"))
