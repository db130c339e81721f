"""Bring a scene to the ground, to a known length, or onto another scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.formats.streams import SceneHeader
from gsedit.formats.usd.units import rescaled
from gsedit.scene.planes import Plane, voted_plane
from gsedit.scene.quaternions import AXES, quaternion_of, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit.decimate import importance
from gsedit.toolkit.operation import Say, Whole
from gsedit.toolkit.registration import register
from gsedit.toolkit.transform import scale

SAMPLED_SPLATS = 20_000
"""Splats that are looked at, drawn by opacity times area."""
TRIES = 2_000
"""Planes through three of them: with one splat in seven on the ground, 5 or more fit it."""
THICKNESS = 0.01
"""Distance that a splat may have from a plane, as a share of the median distance from the middle.
"""
TRIED_SPLATS = 4_000
"""Number of these splats that planes are tried on first."""
LEAST_SHARE = 0.02
"""Share of the splats that a ground holds."""
TILT = 35.0
"""Degrees that the ground may lean against an upward direction that is given."""
UNSURE = 0.2
"""Share of splats with a partner below which a person is told to look."""


def find_ground(table: SplatTable, up: Float64[np.ndarray, "3"]) -> tuple[Plane, float, float]:
    """The plane with most splats on it times the share of the others above it; its share of the
    splats, by opacity times area, and the share of the others that lie above.

    Its normal is at most TILT from `up`. Raises UsageError where no plane holds LEAST_SHARE.
    """
    points = _sample(table)
    thickness = THICKNESS * float(np.median(np.linalg.norm(points - np.median(points, 0), axis=1)))
    voters = points[:TRIED_SPLATS]

    def votes(normals: np.ndarray, offsets: np.ndarray, on: np.ndarray) -> np.ndarray:
        rise, share = normals @ up, on.mean(0)
        over = ((voters @ normals.T - offsets) * np.sign(rise) > thickness).mean(0)
        level = np.abs(rise) > np.cos(np.radians(TILT))
        return level * share * (over / np.maximum(1 - share, 1e-9)) ** 4

    found = voted_plane(voters, thickness, np.random.default_rng(0), votes, tries=TRIES)
    plane = None if found is None else found[0].turned(up)
    heights = np.zeros(0) if plane is None else plane.heights(points)
    share = float(np.mean(np.abs(heights) < thickness)) if len(heights) else 0.0
    if plane is None or share < LEAST_SHARE:
        raise UsageError("no ground was found: name what is up, or turn by transform --rotate")
    return plane, share, float(np.mean(heights > thickness)) / max(1 - share, 1e-9)


def _sample(table: SplatTable) -> Float64[np.ndarray, "n 3"]:
    weight = np.nan_to_num(importance(table), posinf=0.0) * np.isfinite(table.means).all(1)
    if np.count_nonzero(weight) < 10:
        raise UsageError("a scene of so few visible splats has no ground")
    # giants must not decide alone
    weight = np.minimum(weight, 10 * np.median(weight[weight > 0]))
    rows = np.random.default_rng(0).choice(len(weight), SAMPLED_SPLATS, p=weight / weight.sum())
    return table.means[rows].astype(np.float64)


@dataclass(frozen=True, eq=False)
class Align(Whole):
    """An operation that finds where the scene is to go, and moves it there."""

    cameras: bool = field(default=False, kw_only=True)
    """Whether the cameras beside the scene's file are to move along."""
    found: list[Similarity] = field(default_factory=list, repr=False, kw_only=True)
    save: Path | None = field(default=None, kw_only=True)
    """The .json to write the similarity to."""

    @property
    def moves(self) -> bool:
        return True

    @property
    def moved(self) -> Similarity:
        """The similarity that was applied to the scene; known after the work."""
        return self.found[-1] if self.found else IDENTITY

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        similarity = self.find(table, say)
        self.found.append(similarity)
        say(describe(similarity))
        return similarity.table(table)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        """Find the similarity that moves the scene to its new place."""
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
            from gsedit.scene.framing import guess_up

            near = guess_up(gaussians_of(table)).numpy()
        else:
            near = AXES[self.near]
        plane, share, above = find_ground(table, near)
        axis = AXES[self.up]
        tilt = float(np.degrees(np.arccos(np.clip(plane.normal @ axis, -1, 1))))
        say(
            f"the ground leans {tilt:.2f} degrees against {self.up}; it holds "
            f"{100 * share:.0f} % of the scene, {100 * above:.0f} % of the rest above"
        )
        return Similarity(turn_between(plane.normal, axis), 1.0, -plane.offset * axis)


@dataclass(frozen=True, eq=False)
class AlignTo(Align):
    """Lay the scene on another one: gsedit.toolkit.registration."""

    other: SplatTable

    def header(self, header: SceneHeader) -> SceneHeader:
        return rescaled(header, None)

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

    def header(self, header: SceneHeader) -> SceneHeader:
        return rescaled(header, None)

    def find(self, table: SplatTable, say: Say) -> Similarity:
        apart = float(np.linalg.norm(np.subtract(self.first, self.second)))
        if not apart:
            raise UsageError("the two points of a known length are the same")
        say(f"the points are {apart:.6g} apart")
        return scale(self.length / apart)


def describe(similarity: Similarity) -> str:
    """Describe a similarity in one line, for a person."""
    turn = -similarity.turn if similarity.mirrors else similarity.turn
    degrees = 2 * np.degrees(np.arccos(min(quaternion_of(turn)[0], 1.0)))
    move = ", ".join(f"{value:.6g}" for value in similarity.translation)
    return f"scaled by {similarity.scale:.6g}, turned by {degrees:.2f} degrees, moved by {move}"
