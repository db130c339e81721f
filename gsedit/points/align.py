"""Bring a scene to the ground, to a known length, or onto another scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gsedit.errors import UsageError
from gsedit.files.similarity import IDENTITY, Similarity, quaternion_of, turn_between
from gsedit.files.table import SplatTable, gaussians_of
from gsedit.points.ground import find_ground
from gsedit.points.operation import Say, Scene, Whole, apply
from gsedit.points.registration import register
from gsedit.points.steps import AXES, scale


@dataclass(frozen=True, eq=False)
class Align(Whole):
    """An operation that finds where the scene is to go, and moves it there."""

    cameras: bool = field(default=False, kw_only=True)
    """Whether the cameras beside the scene's file are to move along."""
    save: Path | None = field(default=None, kw_only=True)
    """The .json to write the similarity to."""
    found: list[Similarity] = field(default_factory=list, repr=False, kw_only=True)

    @property
    def moves(self) -> bool:
        return True

    @property
    def moved(self) -> Similarity:
        """What was done to the scene; known afterwards."""
        return self.found[-1] if self.found else IDENTITY

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        similarity = self.find(table, say)
        self.found.append(similarity)
        say(describe(similarity))
        return similarity.table(table)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        """Where the scene is to go."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class AlignToGround(Align):
    """Turn the scene so that its ground is level, and move it there along the upward axis.

    `up` is the axis that then points up; `near` the direction that is up now, within 35 degrees
    (None: guessed as for the views of a scene).
    """

    up: str = "-y"
    near: str | None = None

    def __post_init__(self) -> None:
        for axis in (self.up, self.near or "y"):
            if axis not in AXES:
                raise UsageError(f"axis {axis}: {', '.join(AXES)} are possible")

    def find(self, table: SplatTable, say: Say) -> Similarity:
        if self.near is None:
            from gsedit.views.framing import guess_up

            near = guess_up(gaussians_of(table)).numpy()
        else:
            near = np.array(AXES[self.near], np.float64)
        plane = find_ground(table, near)
        axis = np.array(AXES[self.up], np.float64)
        tilt = float(np.degrees(np.arccos(np.clip(plane.normal @ axis, -1, 1))))
        say(
            f"the ground leans {tilt:.2f} degrees against {self.up}; it holds "
            f"{100 * plane.share:.0f} % of the scene, {100 * plane.above:.0f} % of the rest above"
        )
        return Similarity(turn_between(plane.normal, axis), 1.0, -plane.height * axis)


@dataclass(frozen=True, eq=False)
class AlignTo(Align):
    """Lay the scene on another one: gsedit.points.registration."""

    other: SplatTable

    def find(self, table: SplatTable, say: Say) -> Similarity:
        match = register(table, self.other)
        say(
            f"{100 * match.overlap:.0f} % of its splats lie on the other scene, "
            f"{match.residual:.4g} units off (root mean square)"
        )
        if match.overlap < UNSURE:
            say("so few that the two may not show the same thing: look at the result")
        return match.similarity


@dataclass(frozen=True, eq=False)
class AlignLength(Align):
    """Scale the scene about the origin so that two of its points are a length apart."""

    first: Sequence[float]
    second: Sequence[float]
    length: float

    def find(self, table: SplatTable, say: Say) -> Similarity:
        apart = float(np.linalg.norm(np.subtract(self.first, self.second)))
        if not apart:
            raise UsageError("the two points of a known length are the same")
        say(f"the points are {apart:.6g} apart")
        return scale(self.length / apart)


UNSURE = 0.2
"""Share of splats with a partner below which a person is told to look."""


def describe(similarity: Similarity) -> str:
    """For a person."""
    turn = -similarity.turn if similarity.mirrors else similarity.turn
    degrees = 2 * np.degrees(np.arccos(min(quaternion_of(turn)[0], 1.0)))
    move = ", ".join(f"{value:.6g}" for value in similarity.translation)
    return f"scaled by {similarity.scale:.6g}, turned by {degrees:.2f} degrees, moved by {move}"


def align_to_ground(scene: Scene, up: str = "-y", near: str | None = None) -> Scene:
    """The scene on its ground, at 0 along the axis `up`. Raises UsageError where none is found."""
    return apply(scene, AlignToGround(up, near))


def align_length(
    scene: Scene, first: Sequence[float], second: Sequence[float], length: float
) -> Scene:
    """The scene scaled so that two points of it are `length` apart."""
    return apply(scene, AlignLength(first, second, length))


def align_to(scene: Scene, other: SplatTable) -> Scene:
    """The scene laid on another one, which may show only a part of it, or more."""
    return apply(scene, AlignTo(other))
