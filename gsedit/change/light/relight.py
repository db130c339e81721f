"""Light a scene again: the present light is taken off its colors, and another one is put on.

The present light is told roughly. Colors are surface times light. Gaussians of one hue are taken
for one surface; what then is left of their luminance is explained by light from the sky's
directions, at least 0 each, past what hides them. It is the light on each Gaussian, of one color;
the light around one place, from all directions and in color, is gsedit.views.surroundings.

A factor of light is a factor of its GAMMA-th root in display colors, so a Gaussian's color, and
what of it depends on the direction, is multiplied; blending stays exact. Where geometry is not
trusted, far from the subject, the factor is one tone for all, the mean of what is near.
`n` Gaussians, `d` directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int, Int64
from torch import Tensor

from gsedit.change.light.setup import Fog, Lamp, LightSetup, Sun
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.color_space import LUMINANCE, lab_of_srgb, linear_of_srgb
from gsedit.toolkit.grade import GAMMA
from gsedit.views.normals import estimate_normals, neighbor_means, rows_near, visible_area
from gsedit.views.place import Place, place_of
from gsedit.views.shadows import (
    OFFSET_PIXELS,
    SHARP,
    casters,
    lit_share,
    open_share,
    sky_directions,
    spot_map,
    sun_directions,
)
from gsedit.views.surroundings import light_near
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.scene import Gaussians

Vectors = Float[Tensor, "n 3"]

SKY_REACH = 0.5
"""Distance, in the radius, up to which something hides the sky: farther off, captures hold
ceilings and haze."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Gaussians near the subject as light finds them, a row each."""

    points: Vectors
    """Centers in world units, float64."""
    normals: Vectors
    """Outward unit vectors, float64."""
    confidence: Float[Tensor, " n"]
    """Confidence of the normals, in [0, 1]."""
    near: Int[Tensor, "n k"]
    """Rows of the nearest neighbors."""
    directions: Float[Tensor, "d 3"]
    """Directions of the sky, unit vectors, float64."""
    open: Float[Tensor, "n d"]
    """Share of each direction's light that comes through, in [0, 1]."""
    occluders: Gaussians
    place: Place

    def smoothed(self, values: Float[Tensor, "n ..."], rounds: int = 2) -> Float[Tensor, "n ..."]:
        """Means over the nearest neighbors: single Gaussians know their place badly."""
        return neighbor_means(values, self.near, rounds)

    def facing(self, direction: Float[Tensor, "... 3"]) -> Float[Tensor, "n ..."]:
        """Cosine of light from unit vectors, at least 0; where a normal is not sure, that of a leaf
        of any direction, 1 / 4."""
        cosine = (self.normals @ direction.transpose(0, -1)).clamp_min(0)
        sure = self.confidence if direction.ndim == 1 else self.confidence[:, None]
        return sure * cosine + (1 - sure) / 4


def surface_of(scene: Gaussians, place: Place, cameras: Sequence[Camera]) -> Surface:
    """Normals of Gaussians and how much of the sky each sees."""
    near = rows_near(scene.means.detach())
    normals = estimate_normals(scene, cameras, None, near)
    unit = normals.directions.double()
    points = scene.means.detach().double()
    directions = sky_directions(place)
    occluders = casters(scene, place)
    reach = SKY_REACH * place.radius
    seen = open_share(occluders, place, points, directions, normals=unit, reach=reach)
    return Surface(
        points, unit, normals.confidence.double(), near, directions, seen,
        occluders, place,
    )  # fmt: skip


HUE_STEP = 8.0
"""Side of the squares of Lab a and b that count as one surface."""
SAMPLES = 6000
"""Gaussians that the light is fitted to: those that fill the pictures most."""
EVEN = 0.35
"""Weight of an even sky against the evidence, per sample: it is what colors leave open."""
ROUNDS = 6
"""Surfaces and light are fitted in turns."""
LEAST, MOST = 0.3, 2.5
"""Range of the present light against its median: beyond it, the estimate is a guess."""
INDIRECT, THROWN = 0.25, 0.5
"""Share of light that comes from everywhere else, and the largest that a ground throws back."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Surfaces of a scene and the light that it was captured in."""

    place: Place
    surface: Surface
    trust: Float[Tensor, " n"]
    """How much each Gaussian is lit by geometry, in [0, 1]."""
    sky: Float[Tensor, "n c"]
    """Light of weight 1 from each direction of the sky, and from below (see `received`)."""
    seen: Float[Tensor, " n"]
    """How much of the pictures each Gaussian fills, float64."""
    light: Float[Tensor, " n"]
    """Present light on each Gaussian, about 1 on an open, level place."""
    weights: Float[Tensor, " c"]
    """Strength of the present light from each direction of the sky, and from below."""

    def falling_on(self, surface: Surface) -> Float[Tensor, " m"]:
        """Present light on other surfaces of the place, in the range that the scene's is in."""
        light = received(surface) @ self.weights
        return light.clamp(float(self.light.min()), float(self.light.max()))


@cached_per_scene
def survey(
    scene: Gaussians, cameras: Sequence[Camera], seen: Float[Tensor, " n"] | None = None
) -> Survey:
    """Survey a scene that is seen from cameras; `seen` says how much of their pictures each
    Gaussian fills (None: as its size is)."""
    scene = scene.detach()
    if seen is None:
        seen = visible_area(scene)
    place = place_of(scene, cameras, seen)
    surface = surface_of(scene, place, cameras)
    trust, sky = place.trust(surface.points), received(surface)
    colors = sh_to_color(scene.sh[:, 0]).numpy()
    seen = seen.double()
    light, weights = estimate_present(colors, (seen * trust).numpy(), sky)
    return Survey(place, surface, trust, sky, seen, light, weights)


def received(surface: Surface) -> Float[Tensor, "n c"]:
    """Light of weight 1 from each direction of the sky, and last from below, on each Gaussian.

    The directions are scaled so that an even sky gives an open, level place 1."""
    level = surface.directions @ surface.place.up
    from_sky = surface.open * surface.facing(surface.directions) / level.sum()
    openness = surface.open.mean(1)
    below = (1 - surface.normals @ surface.place.up) / 2 * openness
    return torch.cat((from_sky, below[:, None]), 1)


def estimate_present(
    colors: Float[np.ndarray, "n 3"],
    seen: Float[np.ndarray, " n"],
    light_received: Float[Tensor, "n c"],
) -> tuple[Float[Tensor, " n"], Float[Tensor, " c"]]:
    """Present light, fitted to display colors, and its strengths; `seen` is how much of pictures
    each fills."""
    rows = np.argsort(-seen, kind="stable")[:SAMPLES]
    design = light_received.numpy()[rows]
    shown = np.clip(colors[rows].astype(np.float64), 0, 1)
    luminance = linear_of_srgb(shown) @ LUMINANCE
    squares = np.floor(lab_of_srgb(shown)[:, 1:] / HUE_STEP).astype(np.int64)
    hues = np.unique(squares, axis=0, return_inverse=True)[1].reshape(-1)
    fitted = _fitted(design, luminance, hues, np.sqrt(seen[rows]))
    weights = torch.from_numpy(fitted)
    light = light_received @ weights
    middle = float(light[torch.from_numpy(rows)].median().clamp_min(1e-6))
    return light.clamp(LEAST * middle, MOST * middle), weights


def _fitted(
    design: Float64[np.ndarray, "m c"],
    luminance: Float64[np.ndarray, " m"],
    group: Int64[np.ndarray, " m"],
    trust: Float64[np.ndarray, " m"],
) -> Float64[np.ndarray, " c"]:
    """Weights of directions, with one brightness for each group; their mean is 1."""
    count = design.shape[1]
    even = np.ones(count)
    even[-1] = INDIRECT
    weights = even
    trust = trust / max(float(trust.mean()), 1e-12)
    pull = EVEN * np.sqrt(len(design)) / count
    for _ in range(ROUNDS):
        light = np.maximum(design @ weights, 1e-3)
        top = np.bincount(group, trust * luminance * light)
        albedo = (top / np.maximum(np.bincount(group, trust * light * light), 1e-12))[group]
        scaled = design * (trust * albedo)[:, None]
        unit = max(float(np.sqrt(np.square(trust * albedo).mean())), 1e-9)
        weights = light_near(scaled / unit, trust * luminance / unit, even, np.full(count, pull))[0]
        weights = weights / max(float(weights[:-1].mean()), 1e-9)
        weights[-1] = min(weights[-1], THROWN)
    return weights


@dataclass(frozen=True, eq=False)
class ColorChange:
    """Change of display colors, for each Gaussian: its saturation, a factor, and a veil over it."""

    saturation: float
    factor: Vectors
    veil: Float[Tensor, " n"]
    """Share, in [0, 1], that the veil's color replaces."""
    veil_color: Vectors

    def applied(self, scene: Gaussians) -> Gaussians:
        """The scene with its colors changed, from every direction alike."""
        sh = scene.sh.detach().double()
        color = sh_to_color(sh[:, :1])

        def muted(values: Float[Tensor, "n k 3"]) -> Float[Tensor, "n k 3"]:
            gray = (values * torch.from_numpy(LUMINANCE)).sum(-1, keepdim=True)
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


MIDDLE = 0.1
"""Mean linear luminance of a picture that is exposed well: of a display, 0.35."""
ADAPTED = 0.65
"""Power of what is missing to it that the exposure makes up: a night stays darker than a day."""
GLEAM = 0.05
"""Share of the light that is added which any surface throws back, whatever its color."""


def exposure(found: Survey, scene: Gaussians, ratio: Vectors) -> float:
    """Factor, at least 1, of dim light, as eyes and cameras adapt: a gray day's night is no black,
    nor brighter than the day.

    `ratio` is new light over present light. Stronger light stays brighter.
    """
    linear = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1) ** GAMMA
    seen = found.seen / found.seen.sum().clamp_min(1e-12)
    weights = torch.from_numpy(LUMINANCE)
    before, mean = (float(seen @ (each @ weights)) for each in (linear, linear * ratio))
    return max(1.0, min(before, MIDDLE) / max(mean, 1e-6)) ** ADAPTED


def gleaming(scene: Gaussians, light: Vectors) -> Gaussians:
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
SHOULDER = 0.8
"""Display color above which a gain of light is compressed: a lit wall keeps its texture."""


def relit(
    scene: Gaussians,
    setup: LightSetup,
    cameras: Sequence[Camera],
    seen: Float[Tensor, " n"] | None = None,
    inside: Bool[Tensor, " n"] | None = None,
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
    ratio = outside + share * lamps / present
    gain = exposure(found, scene, ratio)
    change = _change(scene, setup, found.place, found.trust, (gain * ratio) ** (1 / GAMMA))
    after = change.applied(scene)
    return gleaming(after, (gain - 1) * (outdoors + lamps))


def light_on(surface: Surface, setup: LightSetup, sky: Float[Tensor, "n c"]) -> Vectors:
    """Linear light of a setup's sky and sun on each Gaussian."""
    up, down = torch.tensor(setup.sky).double(), torch.tensor(setup.ground).double()
    total = sky[:, :-1].sum(1)[:, None] * up + sky[:, -1:] * down
    if setup.sun is not None:
        total = total + _sunlight(surface, setup.sun)
    return total


def _sunlight(surface: Surface, sun: Sun) -> Vectors:
    place = surface.place
    direction = place.direction(sun.azimuth, sun.elevation)
    shares = open_share(
        surface.occluders, place, surface.points, sun_directions(direction, sun.blur),
        normals=surface.normals, side=SHARP, reach=SUN_REACH * place.radius,
    )  # fmt: skip
    arrives = shares.mean(1) * surface.facing(direction)
    return sun.strength * arrives[:, None] * torch.tensor(sun.color).double()


def _lamplight(surface: Surface, lamp: Lamp) -> Vectors:
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
    scene: Gaussians, setup: LightSetup, place: Place, trust: Float[Tensor, " n"], factor: Vectors
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
    luma = color @ torch.from_numpy(LUMINANCE)
    cold = color[:, 2] >= 0.9 * color[:, 0]
    return step(rise, *SKY_RISE) * step(luma, *SKY_BRIGHT) * (1 - trust) * cold


def _fogged(scene: Gaussians, fog: Fog | None, place: Place) -> tuple[Float[Tensor, " n"], Vectors]:
    """Share of each Gaussian that fog hides, and the fog's color."""
    if fog is None:
        return torch.zeros(len(scene)).double(), torch.zeros(len(scene), 3).double()
    away = (scene.means.detach().double() - place.center).norm(dim=-1) / place.distance
    depth = fog.density * (away - fog.start).clamp_min(0)
    share = 1 - (1 - fog.base) * torch.exp(-depth)
    return share, torch.tensor(fog.color).double().expand(len(scene), 3)
