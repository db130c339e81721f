"""Camera paths: a full turn around what cameras look at, a swing to and fro, a spline through them.

`v` cameras, `f` frames. World units; angles in degrees where they are arguments, else radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, radians, sin, tau
from typing import get_args

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.framing import Bounds
from gsedit.views import PathKind
from gsedit.views.dataset import evenly_spaced
from gsedit.views.orbit import perpendicular, towards, unit_up
from rasterizer.camera import Camera, look_at, pose_of

ARC = 60.0
"""Degrees between the ends of an orbit."""
KEYS = 24
"""Cameras that a spline passes through, of a capture that has more: a hand's shake is left out."""
CONVERGED = 0.02
"""Least share of the cameras' optical axes that leads across each direction (the smallest
eigenvalue of their mean projection), for their common point to be known."""
TURNED = 0.02
"""Least second eigenvalue of the cameras' horizontal axes, of which the mean square is 1: below it
they all look the same way, and do not say which of two directions is up."""
HIGHEST = radians(89)
"""Most that a path's cameras look down or up: straight down, no side of a picture is up."""
NEAREST = 1e-3
"""Radii of the scene that a path keeps from its middle, which it looks at: of cameras that stand
right there, as those of a panorama do."""
GATHERED = 0.3
"""Least length of the mean of the cameras' directions, as unit vectors, for them to stand on one
side of the subject."""


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle on which cameras stand that look at one point, typical of some cameras."""

    center: Float[Tensor, "3"]
    """The point that they look at, float64."""
    up: Float[Tensor, "3"]
    """Unit vector, the axis of the circle."""
    east: Float[Tensor, "3"]
    """Unit vector across `up`: azimuth 0, on the side where the cameras stand."""
    distance: float
    """From the point to a camera."""
    elevation: float
    """Elevation of the cameras above the horizon of that point, radians."""
    lens: Camera
    """Camera whose intrinsics and size the frames have."""

    def at(self, azimuth: float) -> Camera:
        """The camera at an azimuth (radians, counter-clockwise seen from above)."""
        direction = towards(self.up, self.east, azimuth, self.elevation)
        eye = self.center + self.distance * direction
        posed = look_at(eye, self.center, self.up, 1.0, self.lens.width, self.lens.height)
        return replace(self.lens, world_to_camera=posed.world_to_camera)


def circle_of(
    cameras: Sequence[Camera],
    *,
    up: Float[Tensor, "3"] | None = None,
    elevation: float | None = None,
    fallback: Bounds | None = None,
) -> Circle:
    """The circle around what the cameras look at: at their median distance and elevation.

    Its azimuth 0 is the middle of the side on which they stand, or the first camera where they
    stand all around. Where they look at no common point, as in a room seen from inside, it is the
    middle of `fallback`. Raises UsageError for no cameras, no common point without a fallback, an
    `up` that is no direction, or an `elevation` (degrees) outside (-90, 90).
    """
    if not cameras:
        raise UsageError("a path needs at least one camera")
    if elevation is not None and not -90 < elevation < 90:
        raise UsageError(f"elevation {elevation:g}: give degrees between -90 and 90")
    axis = unit_up(up_of(cameras) if up is None else up)
    center = common_point(cameras)
    if center is None:
        if fallback is None:
            raise UsageError("the cameras look at no common point to go around: use a spline")
        center = torch.tensor(fallback.center, dtype=torch.float64)
    offsets = torch.stack([camera.center.detach().double() - center for camera in cameras])
    heights = offsets @ axis
    level = offsets - heights[:, None] * axis
    risen = float(torch.atan2(heights, level.norm(dim=-1)).median())
    distance = float(offsets.norm(dim=-1).median())
    if fallback is not None:
        distance = max(distance, NEAREST * fallback.radius)
    return Circle(
        center,
        axis,
        _side(level, axis),
        distance,
        min(max(risen, -HIGHEST), HIGHEST) if elevation is None else radians(elevation),
        cameras[0],
    )


def common_point(cameras: Sequence[Camera]) -> Float[Tensor, "3"] | None:
    """The point nearest to all optical axes (least squares), float64.

    None where the axes are nearly parallel, or where it is behind more than a quarter of the
    cameras.
    """
    eyes = torch.stack([camera.center.detach().double() for camera in cameras])
    ahead = torch.stack([camera.forward.detach().double() for camera in cameras])
    across = torch.eye(3, dtype=torch.float64) - ahead[:, :, None] * ahead[:, None, :]
    mean = across.mean(0)
    if float(torch.linalg.eigvalsh(mean)[0]) < CONVERGED:
        return None
    point = torch.linalg.solve(mean, (across @ eyes[:, :, None]).mean(0)[:, 0])
    before = (((point - eyes) * ahead).sum(-1) > 0).double().mean()
    return point if float(before) >= 0.75 else None  # most cameras have it before them


def up_of(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The upward unit vector of cameras that are held level, float64.

    It is across all of their horizontal axes; where those are parallel, it is the mean of the
    cameras' own upward axes.
    """
    rights = torch.stack([camera.rotation[0].detach().double() for camera in cameras])
    upward = -torch.stack([camera.rotation[1].detach().double() for camera in cameras]).mean(0)
    values, vectors = torch.linalg.eigh(rights.T @ rights / len(rights))
    if float(values[1]) < TURNED:
        if not upward.any():
            return perpendicular(rights[0])
        return torch.nn.functional.normalize(upward, dim=0)
    least = vectors[:, 0]
    return least if float(least @ upward) >= 0 else -least


def turntable(circle: Circle, frames: int) -> tuple[Camera, ...]:
    """A full turn: the frame after the last would be the first, so that it repeats seamlessly."""
    return tuple(circle.at(tau * i / frames) for i in range(frames))


def swing(circle: Circle, frames: int, arc: float = ARC) -> tuple[Camera, ...]:
    """From the middle to one side, to the other and back, `arc` degrees in all; seamless too."""
    if not (isfinite(arc) and 0 < arc <= 360):
        raise UsageError(f"arc {arc:g}: give degrees above 0, at most 360")
    half = radians(arc) / 2
    return tuple(circle.at(half * sin(tau * i / frames)) for i in range(frames))


def spline(cameras: Sequence[Camera], frames: int) -> tuple[Camera, ...]:
    """`frames` cameras on a smooth path through all of `cameras`, from the first to the last.

    Positions lie on a cubic spline, rotations on scipy's `RotationSpline`; both have continuous
    second derivatives. A step between two cameras lasts as long as it is far (in the median step's
    length) and as it turns (in radians). Focal lengths are interpolated; the size is the first
    camera's. Raises UsageError for fewer than two cameras that differ.
    """
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline

    cameras = [*cameras] * (2 if len(cameras) == 1 else 1)  # older scipy has no empty rotations
    poses = np.stack([camera.world_to_camera.detach().double().numpy() for camera in cameras])
    turns = Rotation.from_matrix(poses[:, :3, :3]).inv()
    eyes = -np.einsum("vji,vj->vi", poses[:, :3, :3], poses[:, :3, 3])
    moved = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    typical = np.median(moved[moved > 0]) if (moved > 0).any() else 1.0
    steps = moved / typical + (turns[:-1].inv() * turns[1:]).magnitude()
    distinct = np.r_[True, steps > 1e-6]
    if distinct.sum() < 2:
        raise UsageError("a spline needs two cameras that differ: choose another path")
    when = np.r_[0.0, np.cumsum(steps)][distinct]
    at = np.linspace(0.0, when[-1], frames)
    centers = CubicSpline(when, eyes[distinct])(at)
    rotations = RotationSpline(when, turns[distinct])(at).inv().as_matrix()
    lens = cameras[0]
    kept = [camera for camera, own in zip(cameras, distinct) if own]
    focal = np.interp(at, when, [c.fx * lens.width / c.width for c in kept])
    path = []
    for center, rotation, fx in zip(centers, rotations, focal.tolist()):
        pose = pose_of(rotation, center)
        path.append(replace(lens, world_to_camera=pose, fx=fx, fy=fx * lens.fy / lens.fx))
    return tuple(path)


def camera_path(
    kind: PathKind,
    cameras: Sequence[Camera],
    frames: int,
    *,
    up: Float[Tensor, "3"] | None = None,
    elevation: float | None = None,
    arc: float = ARC,
    fallback: Bounds | None = None,
) -> tuple[Camera, ...]:
    """A path of that kind, from the cameras of a capture or found ones.

    A spline passes through at most `KEYS` of them, evenly spaced. Raises UsageError as `circle_of`,
    `swing` and `spline` do, for no frames, and for a kind that there is not.
    """
    if kind not in get_args(PathKind):
        raise UsageError(f"there is no path {kind!r}: give {', '.join(get_args(PathKind))}")
    if frames < 1:
        raise UsageError(f"{frames} frames: give 1 or more")
    if kind == "spline":
        return spline([cameras[i] for i in evenly_spaced(len(cameras), KEYS)], frames)
    circle = circle_of(cameras, up=up, elevation=elevation, fallback=fallback)
    match kind:
        case "turntable":
            return turntable(circle, frames)
        case "orbit":
            return swing(circle, frames, arc)


def _side(level: Float[Tensor, "v 3"], up: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """The unit vector towards the side where the cameras stand; `level` are their offsets."""
    lengths = level.norm(dim=-1)
    if not float(lengths.max()) > 0:
        return perpendicular(up)
    units = level[lengths > 1e-9 * lengths.max()]
    units = units / units.norm(dim=-1, keepdim=True)
    mean = units.mean(0)
    gathered = float(mean.norm()) >= GATHERED
    return torch.nn.functional.normalize(mean if gathered else units[0], dim=0)
