"""Where to stand around a scene that came without cameras: its bulk, the way up, viewpoints."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, sin

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer.camera import Camera, look_at
from rasterizer.scene import Gaussians

UP_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Bounds:
    """What a scene is about, robust to the far-away splats that every capture has."""

    centre: tuple[float, float, float]
    radius: float


def bounds(scene: Gaussians) -> Bounds:
    """Centre and radius that hold nearly all of an object, or the dense middle of a capture.

    Only the more opaque half counts. Raises UsageError for an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene has no Gaussians: there is nothing to frame")
    opacities = scene.opacities.detach()
    kept = scene[opacities >= opacities.median()].detach().to(torch.float64)
    centre = kept.means.median(0).values
    extent, half, most = _distances(kept.means, centre)  # of a capture: most is surroundings
    if most <= 3 * half:  # an object alone: the middle of all of it, not of where most splats are
        low, high = (kept.means.sort(0).values[int(f * (len(kept) - 1))] for f in (0.03, 0.97))
        centre = (low + high) / 2
        extent = 1.15 * _distances(kept.means, centre)[2]  # what stands out is wanted too
    x, y, z = centre.tolist()
    splat = 3 * float(kept.scales.amax(-1).median())  # they reach beyond their centres
    return Bounds((x, y, z), extent + splat)


def _distances(points: Float[Tensor, "n 3"], centre: Float[Tensor, "3"]) -> tuple[float, ...]:
    """Within which 30 % of the points lie, half of them, and 95 %."""
    distance = (points - centre).norm(dim=-1).sort().values
    return tuple(float(distance[int(f * (len(distance) - 1))]) for f in (0.3, 0.5, 0.95))


def guess_up(scene: Gaussians) -> Float[Tensor, "3"]:
    """The normal of the ground the scene stands on, or INRIA's -y where there is no clear ground.

    Capture frames are seldom level. Of directions all around, this takes the one along which the
    middle 40 % of the centres pile up most in one of 32 layers. A ground has much in it, much above
    it and little below; the shares were chosen on two captures with a ground and three without.
    """
    if not len(scene):
        return up_vector("-y")
    near = scene.means.detach().double()
    near = near - near.median(0).values
    distance = near.norm(dim=1)
    radius = distance.sort().values[int(0.4 * (len(near) - 1))]
    near = near[distance <= radius] / radius.clamp_min(1e-12)
    near = near[:: 1 + len(near) // 20_000]  # enough to find a plane
    directions = _hemisphere(400)
    layers = torch.stack([torch.histc(height, 32, -1, 1) for height in directions @ near.T])
    best = int(layers.amax(1).argmax())
    shares = layers[best] / layers[best].sum()
    ground = int(shares.argmax())
    ahead, behind = float(shares[ground + 2 :].sum()), float(shares[: max(ground - 1, 0)].sum())
    above, below = max(ahead, behind), min(ahead, behind)
    if shares[ground] < 0.22 or above < 0.2 or below > 0.2 * above:
        return up_vector("-y")
    return directions[best] if ahead > behind else -directions[best]


def _hemisphere(count: int) -> Float[Tensor, "n 3"]:
    """Evenly spread directions, one of each opposite pair (a Fibonacci spiral)."""
    index = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - index / count
    turn = index * pi * (1 + 5**0.5)
    return torch.stack(((1 - z**2).sqrt() * turn.cos(), (1 - z**2).sqrt() * turn.sin(), z), 1)


def up_vector(axis: str) -> Float[Tensor, "3"]:
    """The unit vector of an axis name: x, -x, y, -y, z or -z. Raises UsageError otherwise."""
    if axis.lstrip("-") not in UP_AXES or axis.count("-") > 1:
        raise UsageError(f"up axis '{axis}': use one of x, -x, y, -y, z, -z")
    vector = torch.zeros(3, dtype=torch.float64)
    vector[UP_AXES[axis[-1]]] = -1.0 if axis.startswith("-") else 1.0
    return vector


def framing_camera(
    scene: Gaussians, *, up: Float[Tensor, "3"] | None = None, size: tuple[int, int] = (960, 720)
) -> Camera:
    """A camera that sees the bulk of a scene from a little above; `size` is (width, height).

    It aims at the median of the centres; the ball of `bounds` fills the picture, so
    far floaters and backgrounds do not matter. Raises UsageError for an empty scene.
    """
    width, height = size
    bulk = bounds(scene)
    above = guess_up(scene) if up is None else up
    # COLMAP's cameras look along +z, nerfstudio's (z up) stand at -y: 30 degrees from there
    front = -torch.eye(3, dtype=torch.float64)[1 if above[2].abs() > 0.7 else 2]
    side = torch.nn.functional.normalize(torch.linalg.cross(front, above), dim=0)
    direction = 0.87 * torch.linalg.cross(above, side) + 0.5 * side + 0.4 * above
    fov_y = 50.0
    narrower = radians(fov_y) / 2 * min(1.0, width / height)
    distance = bulk.radius / sin(narrower)
    centre = torch.tensor(bulk.centre, dtype=torch.float64)
    eye = centre + distance * direction / direction.norm()
    return look_at(eye, centre, above, fov_y, width, height)
