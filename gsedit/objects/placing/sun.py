"""The sun of a scene, from the shadow that an object casts on the surface under it.

Of many directions, the sun's is that whose shadow of the object is darkest where the surface is.
`n` Gaussians, `m` points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.light.place import Place
from gsedit.light.shadows import (
    FAINT_OPACITY,
    SMALL_SKY,
    lit_share,
    parallel_map,
    sun_directions,
)
from gsedit.objects.placing.stance import Stance, spread
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.quaternions import even_directions
from gsedit.surface.normals import shortest_axes
from gsedit.toolkit.grade import GAMMA
from rasterizer.numerics import AUTO, Execution, sh_to_color
from rasterizer.scene import Gaussians

DIRECTIONS = 400
"""Even directions of the whole sphere, 10 degrees apart, of which those of a sun are tried."""
LOWEST, HIGHEST = 0.2, 0.98
"""Sines of the elevations of suns: a lower one casts shadows out of sight, a higher one none."""
REFINED = (5.0, 2.5)
"""Degrees around the best direction at which others are tried, one after the other."""
AROUND = 2.5
"""Distance from an object's foot, of its height, up to which its shadow is looked for."""
ON_SURFACE = 0.04
"""Height over or under the surface, of the object's, up to which a Gaussian is of it."""
FACES_UP = 0.85
"""Least cosine to the upward direction of the shortest axis of what faces up."""
LAYERS = 70
"""Layers on either side of the foot among which the surface is looked for."""
MOST_POINTS = 6000
"""Gaussians of the surface that are looked at."""
CLEAR = 0.3
"""Least correlation of a shadow with the darkness of a surface that a sun is read from: patterns
and stains have less."""
FEWEST = 30
"""Gaussians of a surface, in a shadow and beside it, that tell how dark it is."""
DARKEST = 0.15
"""Least share of light in a shadow."""
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


def sun_of(scene: Gaussians, stance: Stance) -> Sun | None:
    """The sun whose shadows what stands near an object casts on the surface that it stands on.

    The object is in the scene. None where no sun is clear.
    """
    away = scene.means.double() - stance.foot
    near = scene[away.norm(dim=-1) < AROUND * stance.height]
    stance = replace(stance, foot=stance.foot + _level(near, stance) * stance.up)
    points, light, weights = _surface(near, stance)
    if len(points) < 2 * FEWEST:
        return None
    casters = _casters(near, stance)
    if not len(casters):
        return None
    directions = torch.from_numpy(even_directions(DIRECTIONS)).double()
    rise = directions @ stance.up
    directions = directions[(rise > LOWEST) & (rise < HIGHEST)]
    dark = -(light @ torch.from_numpy(LUMINANCE / LUMINANCE.sum())).clamp_min(1e-3).log()
    dark = dark.clamp(*dark.quantile(torch.tensor((0.02, 0.98)).double()).tolist())
    hidden = _hidden(casters, points, directions).mean(1)
    ground = Ground(points, dark, weights, hidden)
    best, score = _darkest(casters, ground, directions)
    for angle in REFINED:
        best, score = _darkest(casters, ground, sun_ring(best, angle))
    if score < CLEAR:
        return None
    shadow = shadow_of(casters, points, best)
    level = _levels(light, ground, shadow)
    if level is None or float(level.amin()) <= DARKEST:
        return None
    strength = (1 / level - 1) / float(best @ stance.up)
    return Sun(best, strength.clamp_min(0))


def _level(near: Gaussians, stance: Stance) -> float:
    """Height over the foot of the layer that most of what faces up is in."""
    rise = (near.means.double() - stance.foot) @ stance.up
    flat = (shortest_axes(near).double() @ stance.up).abs() > FACES_UP
    step = ON_SURFACE * stance.height
    layers = ((rise / step).round().long() + LAYERS).clamp(0, 2 * LAYERS)
    mass = torch.zeros(2 * LAYERS + 1, dtype=torch.float64)
    mass.index_add_(0, layers, spread(near) * flat)
    best = layers == int(mass.argmax())
    return float(rise[best & flat].median()) if bool((best & flat).any()) else 0.0


def _casters(near: Gaussians, stance: Stance) -> Gaussians:
    rise = (near.means.double() - stance.foot) @ stance.up
    return near[rise > 2 * ON_SURFACE * stance.height]


@dataclass(frozen=True, eq=False)
class Ground:
    points: Float[Tensor, "m 3"]
    dark: Float[Tensor, " m"]
    weights: Float[Tensor, " m"]
    hidden: Float[Tensor, " m"]

    def cleared(self, values: Float[Tensor, "m d"]) -> Float[Tensor, "m d"]:
        """Columns without what their mean and the hidden share of the sky explain."""
        known = torch.stack((torch.ones_like(self.hidden), self.hidden), 1)
        root = (self.weights / self.weights.sum()).sqrt()[:, None]
        found = torch.linalg.lstsq(root * known, root * values).solution
        return root * (values - known @ found)


def sun_ring(direction: Float[Tensor, "3"], degrees: float) -> Float[Tensor, "r 3"]:
    """A direction and some around it."""
    return torch.cat((direction[None], sun_directions(direction, degrees)))


def shadow_of(
    body: Gaussians,
    points: Float[Tensor, "m 3"],
    direction: Float[Tensor, "3"],
    soft: float = SOFT,
    execution: Execution = AUTO,
) -> Float[Tensor, " m"]:
    """Share of the sun, in [0, 1], that an object hides from points."""
    rays = sun_directions(direction, soft)
    return _hidden(body, points, rays, execution).mean(1)


def _hidden(
    body: Gaussians,
    points: Float[Tensor, "m 3"],
    directions: Float[Tensor, "d 3"],
    execution: Execution = AUTO,
) -> Float[Tensor, "m d"]:
    """Share of each direction's light, in [0, 1], that an object hides from points."""
    solid = replace(body, sh=body.sh[:, :1])[body.opacities > FAINT_OPACITY]
    solid = solid if len(solid) else body
    means = solid.means.double()
    middle = (means.amin(0) + means.amax(0)) / 2
    radius = 1.1 * float((means - middle).norm(dim=-1).amax()) + 1e-9
    reach = float((points - middle).norm(dim=-1).amax()) + 3 * radius
    columns = []
    for direction in directions:
        place = Place(middle, perpendicular(direction), direction, 2 * radius, radius)
        drawn = parallel_map(solid, place, direction, SMALL_SKY, execution)
        columns.append(1 - lit_share(drawn, points, reach))
    return torch.stack(columns, 1)


def _surface(
    scene: Gaussians, stance: Stance
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """Places, linear colors and weights of the surface around an object."""
    away = scene.means.double() - stance.foot
    near = (away @ stance.up).abs() < ON_SURFACE * stance.height
    rows = near.nonzero().squeeze(-1)
    rows = rows[:: 1 + len(rows) // MOST_POINTS]
    some = scene[rows]
    colors = sh_to_color(some.sh[:, 0].double()).clamp(0, 1)
    return some.means.double(), colors**GAMMA, spread(some)


def _darkest(casters, ground, directions):
    """The direction whose shadow goes best with what is dark, and their correlation."""
    shadows = ground.cleared(_hidden(casters, ground.points, directions))
    residual = ground.cleared(ground.dark[:, None])
    sizes = shadows.norm(dim=0) * residual.norm()
    scores = (shadows * residual).sum(0) / sizes.clamp_min(1e-9)
    best = int(scores.argmax())
    return directions[best], float(scores[best])


def _levels(light, ground, shadow):
    inside, outside = shadow > 0.7, shadow < 0.3
    if int(inside.sum()) < FEWEST or int(outside.sum()) < FEWEST:
        return None
    share = ground.weights * torch.exp(-((ground.hidden / 0.1) ** 2))
    log = light.clamp_min(1e-3).log()

    def mean(rows):
        return (share[rows, None] * log[rows]).sum(0) / share[rows].sum().clamp_min(1e-12)

    return (mean(inside) - mean(outside)).exp().clamp(DARKEST, 1.0)
