"""The place that cameras look at: its middle, size and upright axes, and where geometry is trusted.

`n` Gaussians; world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.framing import bounds, guess_up, weighted_quantile
from gsedit.views.orbit import perpendicular
from gsedit.views.paths import common_point, up_of
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

TURNED_AROUND = 0.5
"""Least length of the mean of the level views that says where pictures are taken from; a ring of
cameras has 0 and is told from its first camera."""
ALONE = 0.7
"""Radius, in the cameras' distance, below which nothing is around what they look at."""
WHOLE, MARGIN = 0.98, 1.1
"""Share of what is seen that is all of an object without surroundings, and the radius against its
reach."""


@dataclass(frozen=True, eq=False)
class Place:
    """Middle, size and axes of what is lit; axes are unit vectors, float64."""

    center: Float[Tensor, "3"]
    up: Float[Tensor, "3"]
    front: Float[Tensor, "3"]
    """Level, from the center to where the pictures are taken from."""
    distance: float
    """Median distance of the cameras from the center."""
    radius: float
    """Beyond it geometry is not trusted."""

    @property
    def alone(self) -> bool:
        """Whether the cameras look at an object with nothing around it."""
        return self.radius < ALONE * self.distance

    def direction(self, azimuth: float, elevation: float) -> Float[Tensor, "3"]:
        """Unit vector to where light of these angles (degrees, see LightSetup) comes from."""
        right = torch.linalg.cross(self.up, self.front)
        a, e = radians(azimuth), radians(elevation)
        level = cos(a) * self.front + sin(a) * right
        return cos(e) * level + sin(e) * self.up

    def trust(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """How much each point is lit by geometry, in [0, 1]: 1 near the center, 0 far away."""
        away = (points - self.center.to(points)).norm(dim=-1) / self.radius
        return ((1 - away) / 0.35 + 1).clamp(0, 1)  # fades over a third of the radius


def place_of(
    scene: Gaussians, cameras: Sequence[Camera], seen: Float[Tensor, " n"] | None = None
) -> Place:
    """The place that cameras look at, or the bulk of a scene without cameras.

    `seen` says how much of the pictures each Gaussian fills.
    """
    if not cameras:
        bulk = bounds(scene)
        up = guess_up(scene)
        center = torch.tensor(bulk.center, dtype=torch.float64)
        return Place(center, up, perpendicular(up), 2 * bulk.radius, 2 * bulk.radius)
    up = up_of(cameras)
    eyes = torch.stack([camera.center.detach().double() for camera in cameras])
    center = common_point(cameras)
    if center is None:
        center, radius = _seen_ball(scene, seen)
        distance = max(float((eyes - center).norm(dim=-1).median()), 0.5 * radius)
    else:
        distance = float((eyes - center).norm(dim=-1).median())
        radius = min(1.6 * distance, MARGIN * _reach(scene, seen, center, WHOLE))
    return Place(center, up, _front(cameras, up), distance, radius)


def light_note(scene: Gaussians, place: Place, seen: Float[Tensor, " n"] | None) -> str | None:
    """Remark on what of a scene only changes its tone, or that nothing is around it; else None."""
    if place.alone:
        return "nothing is around it: dim light is exposed so that it is seen against black"
    far = 1 - place.trust(scene.means.detach().double())
    weight = torch.ones_like(far) if seen is None else seen.double()
    share = float((far * weight).sum() / weight.sum().clamp_min(1e-12))
    if share < 0.02:  # too little to tell a person of
        return None
    return (
        f"{share:.0%} of what is seen is sky or far from the subject, where geometry is not "
        "trusted: it changes its tone only, without sides and shadows"
    )


def _front(cameras: Sequence[Camera], up: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    backward = -torch.stack([camera.forward.detach().double() for camera in cameras])
    level = backward - (backward @ up)[:, None] * up
    mean = level.mean(0)
    chosen = mean if float(mean.norm()) > TURNED_AROUND else level[0]
    if float(chosen.norm()) < 1e-6:
        return perpendicular(up)
    return torch.nn.functional.normalize(chosen, dim=0)


def _seen_ball(
    scene: Gaussians, seen: Float[Tensor, " n"] | None
) -> tuple[Float[Tensor, "3"], float]:
    """Median and radius of what is seen."""
    points = scene.means.detach().double()
    weight = torch.ones(len(points)).double() if seen is None else seen.double()
    center = weighted_quantile(points, weight, 0.5)
    return center, _reach(scene, seen, center, 0.85)


def _reach(
    scene: Gaussians, seen: Float[Tensor, " n"] | None, center: Float[Tensor, "3"], share: float
) -> float:
    """Radius around a center that holds a share of what is seen."""
    away = (scene.means.detach().double() - center).norm(dim=-1)
    weight = torch.ones_like(away) if seen is None else seen.double()
    return float(weighted_quantile(away[:, None], weight, share))
