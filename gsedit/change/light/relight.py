"""Light a scene again: the present light is taken off its colors, and another one is put on.

A factor of light is a factor of its GAMMA-th root in display colors, so a Gaussian's color, and
what of it depends on the direction, is multiplied; blending stays exact. Where geometry is not
trusted, far from the subject, the factor is one tone for all, the mean of what is near.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.light.present import Surface, Survey, survey
from gsedit.change.light.table import Fog, Lamp, LightSetup, Sun
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.quantiles import weighted_quantile
from gsedit.toolkit.grade import GAMMA
from gsedit.views.place import Place
from gsedit.views.shadows import (
    OFFSET_PIXELS,
    SHARP,
    lit_share,
    open_share,
    spot_map,
    sun_directions,
)
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, SH_DC, Execution, ruled, sh_to_color
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class ColorChange:
    """Change of display colors, for each Gaussian: its saturation, a factor, and a veil over it."""

    saturation: float
    factor: Float[Tensor, "n 3"]
    veil: Float[Tensor, " n"]
    """Share, in [0, 1], that the veil's color replaces."""
    veil_color: Float[Tensor, "n 3"]

    def applied(self, scene: Gaussians) -> Gaussians:
        """The scene with its colors changed, from every direction alike."""
        sh = scene.sh.detach().double()
        color = sh_to_color(sh[:, :1])
        weights = torch.from_numpy(LUMINANCE / LUMINANCE.sum())

        def muted(values: Float[Tensor, "n k 3"]) -> Float[Tensor, "n k 3"]:
            gray = (values * weights).sum(-1, keepdim=True)
            return gray + self.saturation * (values - gray)

        clear = (1 - self.veil)[:, None, None]
        factor = self.factor[:, None] * clear
        color = muted(color) * factor + (self.veil[:, None] * self.veil_color)[:, None]
        rest = muted(sh[:, 1:]) * factor
        return replace(scene, sh=torch.cat(((color - 0.5) / SH_DC, rest), 1).to(scene.sh))


def only_inside(
    before: Gaussians, after: Gaussians, inside: Bool[Tensor, " n"] | None
) -> Gaussians:
    """The later scene inside, the earlier one's coefficients outside; None: inside is all.

    Bands that the earlier scene does not have are 0 outside.
    """
    if inside is None or bool(inside.all()):
        return after
    outside = before.detach().with_degree(after.degree).sh
    return replace(after, sh=torch.where(inside[:, None, None], after.sh, outside))


def step(values: Float[Tensor, "*n"], low: float, high: float) -> Float[Tensor, "*n"]:
    """0 below `low`, 1 above `high`, smooth between; the other way round where `low` is larger."""
    t = ((values - low) / (high - low)).clamp(0, 1)
    return t * t * (3 - 2 * t)


MIDDLE = 0.14
"""Mean linear luminance of a picture that is exposed well: of a display, 0.41."""
ADAPTED = 0.5
"""Power of what is missing to it that the exposure makes up: a night stays darker than a day."""
GLEAM = 0.05
"""Share of the light that is added which any surface throws back, whatever its color."""


def exposure(found: Survey, scene: Gaussians, ratio: Float[Tensor, "n 3"]) -> float:
    """Factor, at least 1, of the light on an object that is alone; 1 where something is around it.

    `ratio` is new light over present light. Stronger light stays brighter.
    """
    if not found.place.alone:
        return 1.0
    linear = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1) ** GAMMA * ratio
    seen = found.seen / found.seen.sum().clamp_min(1e-12)
    mean = float(seen @ (linear @ torch.from_numpy(LUMINANCE / LUMINANCE.sum())))
    return max(1.0, MIDDLE / max(mean, 1e-6)) ** ADAPTED


def gleaming(scene: Gaussians, light: Float[Tensor, "n 3"]) -> Gaussians:
    """The scene with the dull shine that shows the shape of what is black."""
    sh = scene.sh.detach().clone()
    color = sh_to_color(sh[:, 0].double())
    lit = (color.clamp_min(0) ** GAMMA + GLEAM * light) ** (1 / GAMMA)
    sh[:, 0] += ((lit - color.clamp_min(0)) / SH_DC).to(sh)
    return replace(scene, sh=sh)


SUN_REACH = 1.2
"""Distance, in the radius, over which a sun's shadow falls."""
SKY_RISE = (0.02, 0.2)
"""Sine of the elevation above the middle at which what is far away begins to be sky, and is."""
SKY_BRIGHT = (0.45, 0.75)
"""Display luminance at which it may be sky, and is."""
PATCH_RANK, PRESSED = 0.7, 0.6
"""Rank among what is seen above which something may be a patch of sun, and the power of its
brightness that is taken off."""
DIM = (0.45, 0.15)
"""Mean of new light over present light at which patches begin to fade, and where they are taken
off."""
SHOULDER = 0.8
"""Display color above which a gain of light is compressed: a lit wall keeps its texture."""


@ruled
def relit(
    scene: Gaussians,
    setup: LightSetup,
    cameras: Sequence[Camera],
    seen: Float[Tensor, " n"] | None = None,
    inside: Bool[Tensor, " n"] | None = None,
    execution: Execution = AUTO,
) -> Gaussians:
    """The scene in another light; Gaussians that are not `inside` stay the same bits.

    `cameras` say where it is seen from, `seen` how much of their pictures each Gaussian fills
    (None: as its size is).
    """
    found = survey(scene, cameras, seen)
    return only_inside(scene, relit_by(found, scene, setup), inside)


def relit_by(found: Survey, scene: Gaussians, setup: LightSetup) -> Gaussians:
    """The scene that was surveyed, or one with other colors, in another light."""
    surface = found.surface
    present = surface.smoothed(found.light)[:, None]
    outdoors = surface.smoothed(light_on(surface, setup, found.sky))
    lamps = torch.zeros_like(outdoors)
    for lamp in setup.lamps:
        lamps = lamps + surface.smoothed(_lamplight(surface, lamp))
    near = (found.trust * found.seen)[:, None]
    far = (near * outdoors / present).sum(0) / near.sum().clamp_min(1e-12)
    share = found.trust[:, None]
    outside = share * outdoors / present + (1 - share) * far
    outside = outside * patches_kept(found, scene, far, outside)[:, None]
    ratio = outside + share * lamps / present
    gain = exposure(found, scene, ratio)
    change = _change(scene, setup, found.place, found.trust, (gain * ratio) ** (1 / GAMMA))
    after = change.applied(scene)
    return gleaming(after, (gain - 1) * (outdoors + lamps))


def patches_kept(
    found: Survey, scene: Gaussians, mean: Float[Tensor, "3"], ratio: Float[Tensor, "n 3"]
) -> Float[Tensor, " n"]:
    """Factor, at most 1, of what is far brighter than most of a scene, where new light is dim.

    What a day's sun lit through leaves, past all that the scene holds, is no bright surface: it
    would shine at night; so would what is taken for a shadow that it is not in. `ratio` is new
    light over present light, and `mean` its mean.
    """
    weights = torch.from_numpy(LUMINANCE / LUMINANCE.sum())
    luminance = (sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1) ** GAMMA) @ weights
    pivot = weighted_quantile(luminance[:, None], found.seen, PATCH_RANK).clamp_min(1e-4)
    lifted = (ratio @ weights / (mean @ weights).clamp_min(1e-12)).clamp_min(1)
    over = (luminance / pivot).clamp_min(1) * lifted
    return over ** -(PRESSED * step(mean @ weights, *DIM))


def light_on(
    surface: Surface, setup: LightSetup, sky: Float[Tensor, "n c"]
) -> Float[Tensor, "n 3"]:
    """Linear light of a setup's sky and sun on each Gaussian."""
    up, down = torch.tensor(setup.sky).double(), torch.tensor(setup.ground).double()
    total = sky[:, :-1].sum(1)[:, None] * up + sky[:, -1:] * down
    if setup.sun is not None:
        total = total + _sunlight(surface, setup.sun)
    return total


def _sunlight(surface: Surface, sun: Sun) -> Float[Tensor, "n 3"]:
    place = surface.place
    direction = place.direction(sun.azimuth, sun.elevation)
    shares = open_share(
        surface.occluders, place, surface.points, sun_directions(direction, sun.blur),
        normals=surface.normals, side=SHARP, reach=SUN_REACH * place.radius,
    )  # fmt: skip
    arrives = shares.mean(1) * surface.facing(direction)
    return sun.strength * arrives[:, None] * torch.tensor(sun.color).double()


def _lamplight(surface: Surface, lamp: Lamp) -> Float[Tensor, "n 3"]:
    place = surface.place
    direction = place.direction(lamp.azimuth, lamp.elevation)
    distance = lamp.distance * place.distance
    eye = place.center + distance * direction
    seen = spot_map(surface.occluders, place, eye, lamp.cone)
    points = surface.points + OFFSET_PIXELS * 2 * place.radius / SHARP * surface.normals
    to_lamp = eye - points
    away = to_lamp.norm(dim=-1).clamp_min(1e-9)
    unit = to_lamp / away[:, None]
    cosine = (surface.normals * unit).sum(-1).clamp_min(0)
    facing = surface.confidence * cosine + (1 - surface.confidence) / 4
    # soft at the rim: full within four fifths of the cone
    angle = torch.rad2deg(torch.acos((unit @ direction).clamp(-1, 1)))
    rim = ((lamp.cone - angle) / (0.2 * lamp.cone)).clamp(0, 1)
    share = lit_share(seen, points, 2 * place.radius)
    fading = (distance / away.clamp_min(0.2 * distance)).square()
    arrives = share * facing * fading * rim * rim * (3 - 2 * rim)
    return lamp.strength * arrives[:, None] * torch.tensor(lamp.color).double()


def _change(
    scene: Gaussians,
    setup: LightSetup,
    place: Place,
    trust: Float[Tensor, " n"],
    factor: Float[Tensor, "n 3"],
) -> ColorChange:
    """The change of colors: factors with a shoulder, then sky, then fog."""
    color = sh_to_color(scene.sh[:, 0].detach().double())
    brightest = (color * factor).amax(-1, keepdim=True)
    over = (brightest - SHOULDER).clamp_min(0)
    pressed = SHOULDER + (1 - SHOULDER) * over / (over + 1 - SHOULDER)
    factor = torch.where(over > 0, factor * pressed / brightest, factor)
    veil, tint = _fogged(scene, setup.fog, place)
    if setup.backdrop is not None:
        sky = sky_share(scene, place, trust)
        backdrop = torch.tensor(setup.backdrop).double()
        kept = (1 - veil) * (1 - sky)
        total = 1 - kept
        tint = (veil[:, None] * tint + ((1 - veil) * sky)[:, None] * backdrop) / total.clamp_min(
            1e-12
        )[:, None]
        veil = total
    return ColorChange(setup.saturation, factor, veil, tint)


def sky_share(scene: Gaussians, place: Place, trust: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """How surely each Gaussian is sky, in [0, 1]: far, above the horizon, bright and of no warm
    color."""
    away = scene.means.detach().double() - place.center
    rise = away @ place.up / away.norm(dim=-1).clamp_min(1e-12)
    color = sh_to_color(scene.sh[:, 0].detach().double())
    luma = color @ torch.from_numpy(LUMINANCE / LUMINANCE.sum())
    cold = color[:, 2] >= 0.9 * color[:, 0]
    return step(rise, *SKY_RISE) * step(luma, *SKY_BRIGHT) * (1 - trust) * cold


def _fogged(
    scene: Gaussians, fog: Fog | None, place: Place
) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
    """Share of each Gaussian that fog hides, and the fog's color."""
    if fog is None:
        return torch.zeros(len(scene)).double(), torch.zeros(len(scene), 3).double()
    away = (scene.means.detach().double() - place.center).norm(dim=-1) / place.distance
    depth = fog.density * (away - fog.start).clamp_min(0)
    share = 1 - (1 - fog.base) * torch.exp(-depth)
    return share, torch.tensor(fog.color).double().expand(len(scene), 3)
