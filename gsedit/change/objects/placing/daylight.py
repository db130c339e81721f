"""Light around an object: from an even sky past what hides it, and from a sun, if shadows tell one.

Linear light, 1 on a level, open place out of the sun; display colors change by the GAMMA-th root.
`n` Gaussians, `m` points, `d` directions, `c` channels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.change.light.relight import SKY_REACH
from gsedit.change.objects.placing.stance import Stance
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.merging import coarsen
from gsedit.scene.outcome import Outcome
from gsedit.scene.quaternions import even_directions
from gsedit.toolkit.grade import GAMMA
from gsedit.views.normals import neighbor_means, rows_near, shortest_axes, visible_area
from gsedit.views.place import Place
from gsedit.views.shadows import (
    SHARP,
    casters,
    open_share,
    past_body,
    sky_directions,
    sun_directions,
)
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.scene import Gaussians

DIRECTIONS = 240
"""Even directions of the whole sphere, 13 degrees apart, of which those of a sun are tried."""
LOWEST, HIGHEST = 0.2, 0.98
"""Sines of the elevations of suns: a lower one casts shadows out of sight, a higher one none."""
OVERHEAD = 0.95
"""Sine of the elevation beyond which a sun is none: what is close to things is dark without one."""
REFINED = (6.0, 3.0)
"""Degrees around the best direction at which others are tried, one after the other."""
SHADOWED = 2.5
"""Distance from an object's foot, of its height, up to which shadows are looked for."""
ON_SURFACE = 0.04
"""Height over or under the surface, of the object's, up to which a Gaussian is of it."""
FACES_UP = 0.85
"""Least cosine to the upward direction of the shortest axis of what faces up."""
LAYERS = 70
"""Layers on either side of the foot among which the surface is looked for."""
MOST_POINTS = 6000
"""Gaussians of the surface that are looked at."""
MOST_CASTERS = 100_000
"""Gaussians that are looked at as casting shadows; more are merged: each direction is a picture."""
CLEAR = 0.3
"""Least correlation of shadows with the darkness of a surface that a sun is read from. Of the
suns of eight objects in five synthetic scenes above it, all were within 13 degrees; the statue of a
capture under trees has 0.17."""
FEWEST = 30
"""Gaussians of a surface, in a shadow and beside it, that tell how dark it is."""
DARKEST = 0.15
"""Share of light in a shadow at which it is taken for paint."""
DEEP, BRIGHT = 0.7, 0.3
"""Hidden shares of the sun above which a point is in the shadow, and below which it is not."""
NEAR_BODIES = 0.1
"""Hidden share of the sky at which a point counts little for the depth of a shadow."""
SOFT = 3.0
"""Degrees around the sun's direction that its light comes from: shadows have soft edges."""


@dataclass(frozen=True, eq=False)
class Sun:
    """Light from one direction."""

    direction: Float[Tensor, "3"]
    """Unit vector to where it comes from, float64."""
    strength: Float[Tensor, "3"]
    """Linear light of it, a channel each, on what faces it, against that of the sky on a level and
    open place."""


@dataclass(frozen=True, eq=False)
class _Ground:
    """Points of a level surface, and how dark it is there."""

    points: Float[Tensor, "m 3"]
    light: Float[Tensor, "m 3"]
    """Linear colors of the points."""
    weights: Float[Tensor, " m"]

    @property
    def dark(self) -> Float[Tensor, " m"]:
        """Minus the logarithm of the luminance, without the darkest and brightest points."""
        luminance = self.light @ torch.from_numpy(LUMINANCE)
        dark = -luminance.clamp_min(1e-3).log()
        low, high = dark.quantile(dark.new_tensor((0.02, 0.98))).tolist()
        return dark.clamp(low, high)

    def cleared(
        self, values: Float[Tensor, "m d"], hidden: Float[Tensor, " m"]
    ) -> Float[Tensor, "m d"]:
        """Columns, by the roots of the weights, without what a constant and the hidden share of
        the sky explain of them."""
        known = torch.stack((torch.ones_like(hidden), hidden), 1)
        root = (self.weights / self.weights.sum()).sqrt()[:, None]
        found = torch.linalg.lstsq(root * known, root * values).solution
        return root * (values - known @ found)


@cached_per_scene
def sun_of(scene: Gaussians, stance: Stance) -> Sun | None:
    """The sun whose shadows what stands around an object casts on the surface there.

    The object is in the scene. None where no sun is clear.
    """
    away = scene.means.double() - stance.foot
    near = scene[away.norm(dim=-1) < SHADOWED * stance.height]
    if not len(near):
        return None
    merged = coarsen(near, MOST_CASTERS)
    near = near if merged is None else merged.scene
    rise = (near.means.double() - stance.foot) @ stance.up
    rise = rise - _level(near, rise, stance)
    ground = _ground(near, rise.abs() < ON_SURFACE * stance.height)
    casters = near[rise > 2 * ON_SURFACE * stance.height]
    if len(ground.points) < 2 * FEWEST or not len(casters):
        return None
    directions = torch.from_numpy(even_directions(DIRECTIONS)).double()
    sine = directions @ stance.up
    directions = directions[(sine > LOWEST) & (sine < HIGHEST)]
    shadows = 1 - past_body(casters, ground.points, directions)
    hidden = shadows.mean(1)
    best, score = _darkest(ground, hidden, directions, shadows)
    for angle in REFINED:
        ring = torch.cat((best[None], sun_directions(best, angle)))
        tried = 1 - past_body(casters, ground.points, ring)
        best, score = _darkest(ground, hidden, ring, tried)
    if score < CLEAR or float(best @ stance.up) > OVERHEAD:
        return None
    shadow = shadow_of(casters, ground.points, best)
    level = _depth(ground, hidden, shadow)
    if level is None:
        return None
    return Sun(best, (1 / level - 1) / float(best @ stance.up))


def shadow_of(
    body: Gaussians, points: Float[Tensor, "m 3"], direction: Float[Tensor, "3"]
) -> Float[Tensor, " m"]:
    """Share of the sun in a direction, in [0, 1], that an object hides from points."""
    return 1 - past_body(body, points, sun_directions(direction, SOFT)).mean(1)


def _level(near: Gaussians, rise: Float[Tensor, " n"], stance: Stance) -> float:
    """Height over the foot of the layer that most of what faces up is in."""
    flat = (shortest_axes(near).double() @ stance.up).abs() > FACES_UP
    layers = (rise / (ON_SURFACE * stance.height)).round().long() + LAYERS
    layers = layers.clamp(0, 2 * LAYERS)
    mass = torch.zeros(2 * LAYERS + 1, dtype=torch.float64)
    mass.index_add_(0, layers, visible_area(near) * flat)
    fullest = flat & (layers == int(mass.argmax()))
    return float(rise[fullest].median()) if bool(fullest.any()) else 0.0


def _ground(scene: Gaussians, flags: Tensor) -> _Ground:
    rows = flags.nonzero().squeeze(-1)
    some = scene[rows[:: 1 + len(rows) // MOST_POINTS]]
    colors = sh_to_color(some.sh[:, 0].double()).clamp(0, 1)
    return _Ground(some.means.double(), colors**GAMMA, visible_area(some))


def _darkest(
    ground: _Ground,
    hidden: Float[Tensor, " m"],
    directions: Float[Tensor, "d 3"],
    shadows: Float[Tensor, "m d"],
) -> tuple[Float[Tensor, "3"], float]:
    """The direction whose shadow goes best with what is dark, and their correlation."""
    cast = ground.cleared(shadows, hidden)
    dark = ground.cleared(ground.dark[:, None], hidden)
    scores = (cast * dark).sum(0) / (cast.norm(dim=0) * dark.norm()).clamp_min(1e-9)
    best = int(scores.argmax())
    return directions[best], float(scores[best])


def _depth(
    ground: _Ground, hidden: Float[Tensor, " m"], shadow: Float[Tensor, " m"]
) -> Float[Tensor, "3"] | None:
    """Light of a surface in the shadow against that beside it, a channel each; None where that is
    not to be told. What is close to things, where the sky is hidden too, counts little."""
    inside, outside = shadow > DEEP, shadow < BRIGHT
    if int(inside.sum()) < FEWEST or int(outside.sum()) < FEWEST:
        return None
    share = ground.weights * torch.exp(-((hidden / NEAR_BODIES) ** 2))
    log = ground.light.clamp_min(1e-3).log()

    def mean(rows: Tensor) -> Tensor:
        return (share[rows, None] * log[rows]).sum(0) / share[rows].sum().clamp_min(1e-12)

    level = (mean(inside) - mean(outside)).exp()
    return level.clamp_max(1.0) if float(level.amin()) > DARKEST else None


AMBIENT = 0.3
"""Share of the sky's light that comes around everything: no shadow is darker."""
SKY = 96
"""Even directions of the whole sphere, of which those above the ground are the sky: with fewer, the
edges of single shadows show."""
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
    """The light of a scene: an even sky over a place, and a sun, if there is one."""

    place: Place
    sun: Sun | None

    @cached_property
    def directions(self) -> Float[Tensor, "d 3"]:
        """Directions of the sky, unit vectors, float64."""
        return sky_directions(self.place, SKY)

    def received(
        self,
        normals: Float[Tensor, "n 3"],
        sky: Float[Tensor, "n d"] | float,
        sunlit: Float[Tensor, " n"] | float,
    ) -> Float[Tensor, "n c"]:
        """Light on surfaces of outward normals that see these shares of sky and sun."""
        level = (self.directions @ self.place.up).sum()
        cosine = (normals @ self.directions.T).clamp_min(0)
        sky = torch.as_tensor(sky).expand_as(cosine)
        around = (1 - AMBIENT) * (cosine * sky).sum(1) / level + AMBIENT * sky.mean(1)
        light = around[:, None].expand(-1, 3) + AMBIENT / 2
        if self.sun is None:
            return light
        facing = (normals @ self.sun.direction).clamp_min(0) * sunlit
        return light + facing[:, None] * self.sun.strength

    def past(
        self, body: Gaussians, points: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, "n d"], Float[Tensor, " n"] | float]:
        """Shares of the sky and of the sun that come past an object."""
        sky = past_body(body, points, self.directions, normals=normals)
        if self.sun is None:
            return sky, 1.0
        return sky, 1 - shadow_of(body, points, self.sun.direction)

    def sunlit(self, rest: Gaussians, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"] | float:
        """Share of the sun that the rest of a scene leaves to points."""
        if self.sun is None:
            return 1.0
        rays, reach = sun_directions(self.sun.direction, SOFT), 2 * self.place.radius
        return open_share(
            casters(rest, self.place), self.place, points, rays,
            side=SHARP, reach=reach,
        ).mean(1)  # fmt: skip

    def on_object(
        self, body: Gaussians, normals: Float[Tensor, "n 3"], rest: Gaussians
    ) -> Float[Tensor, "n c"]:
        """Light on an object past itself and past the rest of a scene."""
        points = body.means.double()
        sky, sun = self.past(body, points, normals)
        open_ = open_share(
            casters(rest, self.place), self.place, points, self.directions,
            reach=SKY_REACH * self.place.radius,
        )  # fmt: skip
        return self.received(normals, sky * open_, sun * self.sunlit(rest, points))


def shaded(scene: Outcome, body: Gaussians, stance: Stance, light: Daylight) -> Outcome:
    """An outcome with a soft shadow of an object that is put into its scene."""
    rows = _near(scene.scene, body, stance, light)
    if not len(rows):
        return scene
    some = scene.scene[rows]
    points, normals = some.means.double(), _facing_up(some, light.place.up)
    sunlit = light.sunlit(scene.scene, points)
    sky, sun = light.past(body, points, normals)
    then, now = light.received(normals, 1.0, sunlit), light.received(normals, sky, sun * sunlit)
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
) -> Gaussians:
    """A moved object in the light of its new place.

    `normals` are those before the move, and `turn` its rotation. Neighbors change alike: what
    single Gaussians tell is noise.
    """
    before = light.on_object(body, normals, rest)
    ratio = light.on_object(there, normals @ turn.T, rest) / before
    near = rows_near(body.means)
    return dimmed(there, neighbor_means(ratio, near, 3).clamp(*SHADE))


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


def dimmed(scene: Gaussians, light: Float[Tensor, "n c"]) -> Gaussians:
    """A scene whose Gaussians have factors of light a channel: all of their SH follow."""
    factor = (light ** (1 / GAMMA)).to(scene.sh)
    sh = scene.sh * factor[:, None]
    sh[:, 0] += (factor - 1) * (0.5 / SH_DC)
    felt = ((factor - 1).abs() > FELT).any(-1)
    return replace(scene, sh=torch.where(felt[:, None, None], sh, scene.sh))
