"""Light that things take at a place: from an even sky past what hides it, and from a sun if any.

Linear light, 1 on a level, open place out of the sun; display colors change by the GAMMA-th root.
`n` Gaussians, `d` directions, `c` channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.cameras.place import Place
from gsedit.light.shadows import (
    SHARP,
    SMALL_SKY,
    casters,
    lit_share,
    parallel_map,
    sky_directions,
    sun_directions,
)
from gsedit.light.surface import SKY_REACH
from gsedit.objects.outcome import Outcome
from gsedit.objects.placing.stance import Stance
from gsedit.objects.placing.sun import SOFT, Sun, shadow_of
from gsedit.scene.neighbors import nearest
from gsedit.surface.means import neighbor_means
from gsedit.surface.normals import shortest_axes
from gsedit.surface.occlusion import occupancy, open_share
from gsedit.toolkit.grade import GAMMA
from rasterizer.numerics import AUTO, SH_DC, Execution
from rasterizer.scene import Gaussians

AMBIENT = 0.3
"""Share of the sky's light that comes around everything: no shadow is darker."""
SKY_SOFT = 12.0
"""Degrees around each direction that its light comes from: directions are 29 apart."""
FOOT = 0.12
"""Part of an object's height, from below, whose shadow close to it is computed by itself."""
CONTACT = 1.6
"""Power of the sky's share past an object: rays begin off a surface and miss what is nearest."""
SHADE = (0.35, 2.5)
"""Range of the light that a thing gets against that before: beyond it, the estimate is a guess."""
FELT = 0.005
"""Change of a display color, as a share of it, below which a Gaussian keeps its bits."""
AROUND = 2.2
"""Distance from an object, of its size, up to which it keeps light from what is there; with a sun,
SUNNY times as far."""
SUNNY = 2.0


@dataclass(frozen=True, eq=False)
class Daylight:
    """The light of a scene."""

    place: Place
    directions: Float[Tensor, "d 3"]
    """Directions of the sky, unit vectors, float64."""
    sun: Sun | None

    def received(
        self,
        normals: Float[Tensor, "n 3"],
        sky: Float[Tensor, "n d"],
        sunlit: Float[Tensor, " n"] | None,
    ) -> Float[Tensor, "n c"]:
        """Light on surfaces of outward normals that see these shares of sky and sun."""
        level = (self.directions @ self.place.up).sum()
        cosine = (normals @ self.directions.T).clamp_min(0)
        around = (1 - AMBIENT) * (cosine * sky).sum(1) / level + AMBIENT * sky.mean(1)
        light = around[:, None].expand(-1, 3)
        if self.sun is None or sunlit is None:
            return light + AMBIENT / 2
        facing = (normals @ self.sun.direction).clamp_min(0) * sunlit
        return light + AMBIENT / 2 + facing[:, None] * self.sun.strength


def daylight(place: Place, sun: Sun | None) -> Daylight:
    """An even sky over a place, and a sun."""
    return Daylight(place, sky_directions(place), sun)


def shaded(
    scene: Outcome,
    body: Gaussians,
    stance: Stance,
    light: Daylight,
    execution: Execution = AUTO,
) -> Outcome:
    """An outcome with a soft shadow of an object that is put into its scene."""
    rows = _near(scene.scene, body, stance, light)
    if not len(rows):
        return scene
    some = scene.scene[rows]
    points, normals = some.means.double(), _facing_up(some, light.place.up)
    sunlit = _sunlit(scene.scene, points, light, execution)
    everything = torch.ones(len(rows), len(light.directions), dtype=torch.float64)
    then = light.received(normals, everything, sunlit)
    rise = (body.means.double() - stance.foot) @ stance.up
    foot = body[rise < FOOT * stance.height]
    sky = _open([body, foot], points, normals, light.directions) ** CONTACT
    if sunlit is not None and light.sun is not None:
        sunlit = sunlit * (1 - shadow_of(body, points, light.sun.direction, execution))
    now = light.received(normals, sky, sunlit)
    dim = dimmed(some, (now / then).clamp(*SHADE))
    sh = scene.scene.sh.clone()
    sh[rows] = dim.sh
    changed = scene.changed.clone()
    changed[rows] |= (dim.sh != some.sh).flatten(1).any(1)
    return replace(scene, scene=replace(scene.scene, sh=sh), changed=changed)


def relit_elsewhere(
    body: Gaussians,
    there: Gaussians,
    normals: Float[Tensor, "n 3"],
    turn: Float[Tensor, "3 3"],
    rest: Gaussians,
    light: Daylight,
    execution: Execution = AUTO,
) -> Gaussians:
    """A moved object in the light of its new place.

    `normals` are those before the move, and `turn` its rotation. Neighbors change alike: what
    single Gaussians tell is noise.
    """
    own = [_own_light(*each, rest, light, execution) for each in (
        (body, normals), (there, normals @ turn.T)
    )]  # fmt: skip
    near = torch.from_numpy(nearest(body.means.float().numpy())[1])
    ratio = neighbor_means(own[1] / own[0], near, 3)
    return dimmed(there, ratio.clamp(*SHADE))


def _own_light(
    body: Gaussians,
    normals: Float[Tensor, "n 3"],
    rest: Gaussians,
    light: Daylight,
    execution: Execution,
) -> Float[Tensor, "n c"]:
    """Light on an object past itself and past the rest of a scene."""
    points = body.means.double()
    sky = _open([body], points, normals, light.directions) * _sky(rest, points, light, execution)
    sunlit = _sunlit(rest, points, light, execution)
    if sunlit is not None and light.sun is not None:
        sunlit = sunlit * (1 - shadow_of(body, points, light.sun.direction, execution))
    return light.received(normals, sky, sunlit)


def _near(scene: Gaussians, body: Gaussians, stance: Stance, light: Daylight) -> Int[Tensor, " m"]:
    """The rows of what is beside or below an object."""
    points, ours = scene.means.double(), body.means.double()
    middle = (ours.amin(0) + ours.amax(0)) / 2
    reach = AROUND * float((ours - middle).norm(dim=-1).amax())
    reach = reach if light.sun is None else SUNNY * reach
    rise = (points - stance.foot) @ stance.up
    near = ((points - middle).norm(dim=-1) < reach) & (rise < stance.height)
    return near.nonzero().squeeze(-1)


def _facing_up(scene: Gaussians, up: Float[Tensor, "3"]) -> Float[Tensor, "n 3"]:
    """Upward normals: along shortest axes, where Gaussians are flat."""
    axes = shortest_axes(scene).double()
    turned = axes * torch.where(axes @ up < 0, -1.0, 1.0)[:, None]
    return torch.nn.functional.normalize(turned + 0.5 * up, dim=-1)


def _open(
    things: Sequence[Gaussians],
    points: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    directions: Float[Tensor, "d 3"],
) -> Float[Tensor, "n d"]:
    """Share of each direction's soft light that comes past things; parts of few Gaussians are seen
    in finer cells."""
    rays = torch.stack([sun_directions(each, SKY_SOFT) for each in directions]).float()
    flat = rays.reshape(1, -1, 3).expand(len(points), -1, 3)
    seen = torch.ones(flat.shape[:2])
    for each in things:
        if len(each):
            seen *= open_share(occupancy(each), points.float(), normals.float(), flat)
    return seen.reshape(len(points), *rays.shape[:2]).mean(-1).double()


def _sky(
    rest: Gaussians, points: Float[Tensor, "n 3"], light: Daylight, execution: Execution
) -> Float[Tensor, "n d"]:
    """Share of each direction that the rest of a scene leaves open to points."""
    place, occluders = light.place, casters(rest, light.place)
    reach = SKY_REACH * place.radius
    maps = (parallel_map(occluders, place, each, SMALL_SKY, execution) for each in light.directions)
    return torch.stack([lit_share(each, points, reach) for each in maps], 1)


def _sunlit(
    rest: Gaussians, points: Float[Tensor, "n 3"], light: Daylight, execution: Execution
) -> Float[Tensor, " n"] | None:
    """Share of the sun that the rest of a scene leaves to points; None without a sun."""
    if light.sun is None:
        return None
    place, occluders = light.place, casters(rest, light.place)
    rays = sun_directions(light.sun.direction, SOFT)
    maps = (parallel_map(occluders, place, ray, SHARP, execution) for ray in rays)
    return torch.stack([lit_share(each, points, 2 * place.radius) for each in maps]).mean(0)


def dimmed(scene: Gaussians, light: Float[Tensor, "n c"]) -> Gaussians:
    """A scene whose Gaussians have factors of light a channel: all of their SH follow."""
    factor = (light ** (1 / GAMMA)).to(scene.sh)
    sh = scene.sh * factor[:, None]
    sh[:, 0] += (factor - 1) * (0.5 / SH_DC)
    felt = ((factor - 1).abs() > FELT).any(-1)
    return replace(scene, sh=torch.where(felt[:, None, None], sh, scene.sh))
