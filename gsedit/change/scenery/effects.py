"""Weather and seasons, rows of gsedit/words/looks/weathers.txt: light, how surfaces look, colors
that depend on the view; and what they change: foliage, what faces up, the sky.

Covers, leaves and water change colors alike from every side; gloss of what is wet is spherical
harmonics of degree 2.
`n` Gaussians, of which `m` change; `d` directions they are seen from; `k` coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.light.relight import (
    ColorChange,
    Survey,
    only_inside,
    relit_by,
    sky_share,
    step,
    survey,
)
from gsedit.change.light.setup import LIGHTS, SKIES, LightSetup
from gsedit.errors import UsageError
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.color_space import LUMINANCE, lab_of_srgb, linear_of_srgb
from gsedit.scene.quaternions import even_directions
from gsedit.select.region import lift
from gsedit.toolkit.grade import GAMMA
from gsedit.views.dataset import evenly_spaced
from gsedit.views.noise import noise
from gsedit.views.surroundings import find_surroundings, prefiltered, reflected
from gsedit.words.names import TABLE, Row
from rasterizer.camera import Camera
from rasterizer.harmonics import basis
from rasterizer.numerics import sh_to_color
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

GREEN_HUES = (92.0, 104.0, 165.0, 185.0)
"""Angles in Lab, degrees, at which foliage begins, surely is, ends to be sure, and ends."""
GREEN_CHROMA = (9.0, 18.0)
"""Lab chroma below which nothing is foliage, and above which all that is green is."""
SMOOTH, LAWN_CHROMA = (0.92, 0.97), (32.0, 20.0)
"""Confidence of normals at which a surface begins to be smooth, and is; Lab chroma from which a
green there is a lawn's, and below which it is a stain's."""
LEAFY = (0.2, 0.55)
"""Mean greenness of what is seen of a Gaussian from which it is foliage: the color of a single
Gaussian is noise, that of its pixels is not."""
FOLIAGE_VIEWS, FOLIAGE_PIXELS, MIN_SEEN_PIXELS = 12, 160, 0.02
"""Most pictures that tell foliage, their longer side, and pixels below which one is not seen."""
CLUMP, LEAF = 0.11, 0.022
"""Sizes of clumps and leaves, in the cameras' distance from the subject."""
OVERHEAD = 0.6
"""Least height of the directions of the sky that snow and rain fall from."""


def greenness(colors: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n"]:
    """How surely display colors are those of leaves, in [0, 1]."""
    lab = lab_of_srgb(colors.numpy())
    hue = torch.from_numpy(np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360)
    chroma = torch.from_numpy(np.hypot(lab[..., 1], lab[..., 2]))
    begin, sure, last, end = GREEN_HUES
    return step(hue, begin, sure) * step(hue, end, last) * step(chroma, *GREEN_CHROMA)


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene, its survey, and the parts of it."""

    scene: Gaussians
    found: Survey
    cameras: Sequence[Camera] = ()
    """Cameras that pictures are taken from, which tell foliage; any size."""

    @cached_property
    def colors(self) -> Float[Tensor, "n 3"]:
        """Display colors in [0, 1], float64."""
        return sh_to_color(self.scene.sh[:, 0].detach().double()).clamp(0, 1)

    @cached_property
    def luminance(self) -> Float[Tensor, " n"]:
        """Linear luminance of the colors."""
        return torch.from_numpy(linear_of_srgb(self.colors.numpy()) @ LUMINANCE)

    @cached_property
    def rise(self) -> Float[Tensor, " n"]:
        """Cosine between the normal and up."""
        return self.found.surface.normals @ self.found.place.up

    @property
    def sure(self) -> Float[Tensor, " n"]:
        """Confidence of the normals: about 0.5 in foliage."""
        return step(self.found.surface.confidence, 0.45, 0.85)

    @cached_property
    def overhead(self) -> Float[Tensor, " n"]:
        """Share of the sky overhead that is open."""
        surface = self.found.surface
        high = surface.directions @ self.found.place.up > OVERHEAD
        return surface.smoothed(surface.open[:, high].mean(1), 1)

    @cached_property
    def sky(self) -> Float[Tensor, " n"]:
        """How surely each Gaussian is sky."""
        return sky_share(self.scene, self.found.place, self.found.trust)

    @cached_property
    def foliage(self) -> Float[Tensor, " n"]:
        """Share of leaves and grass: green, and on a smooth surface as vivid as a lawn."""
        own = self.found.surface.smoothed(greenness(self.colors), 1)
        chosen = evenly_spaced(len(self.cameras), FOLIAGE_VIEWS)
        cameras = [self.cameras[i].fitted(FOLIAGE_PIXELS) for i in chosen]
        if not cameras:
            return step(own, *LEAFY) * (1 - self._stained)
        pictures = [render_picture(self.scene, each) for each in cameras]
        maps = [greenness(picture.double().clamp(0, 1)).float() for picture in pictures]
        seen = lift(self.scene, cameras, maps)
        green = torch.where(seen.weight > MIN_SEEN_PIXELS, seen.mean.double(), own)
        return step(self.found.surface.smoothed(green, 1), *LEAFY) * (1 - self._stained)

    @property
    def _stained(self) -> Float[Tensor, " n"]:
        """How surely a green is a stain: pale, on a smooth surface."""
        surface = self.found.surface
        lab = torch.from_numpy(lab_of_srgb(surface.smoothed(self.colors, 1).numpy()))
        pale = step(lab[:, 1:].norm(dim=-1), *LAWN_CHROMA)
        return step(surface.confidence, *SMOOTH) * pale * self.found.trust

    def noise(self, size: float, seed: int = 0) -> Float[Tensor, " n"]:
        """Noise of mean 0 and deviation 1 whose features have a size, in the cameras' distance."""
        place = self.found.place
        return noise((self.found.surface.points - place.center) / (size * place.distance), seed)

    def lit(self, dark: float, bright: float) -> Float[Tensor, " n"]:
        """Present light on each Gaussian, from 0 at `dark` to 1 at `bright`."""
        return step(self.found.surface.smoothed(self.found.light), dark, bright)

    def detail(self, share: float) -> Float[Tensor, " n"]:
        """Luminance against that of the neighbors, softened to a share of its contrast."""
        around = self.found.surface.smoothed(self.luminance, 3)
        ratio = (self.luminance + 0.01) / (around + 0.01)
        return ratio.clamp(0.3, 2.0) ** (share / GAMMA)


DEGREE = 2
"""Least degree of the result."""
VIEWS = 48
"""Even directions of the sphere; a Gaussian is seen from those on its outer side."""
ROUGH_WET, ROUGH_PUDDLE = 0.3, 0.1
"""Roughness of a wet surface, and of standing water."""
WATER = 0.02
"""Reflectance of water that is looked at straight."""
LEAST_WET = 0.15
"""Wetness below which nothing shines."""
RIDGE = 0.02
"""Weight of the coefficients' size against the fit: directions below the surface are not seen."""


def wetness(setting: Setting) -> Float[Tensor, " n"]:
    """How wet each Gaussian is, in [0, 1]: what faces up and is open above; sides in streaks."""
    flat = step(setting.rise, 0.15, 0.75)
    streaks = 0.55 * step(setting.noise(3 * LEAF, 21), -0.8, 0.8)
    open_above = step(setting.overhead, 0.1, 0.5)
    return torch.maximum(flat, streaks) * (0.25 + 0.75 * open_above) * (1 - setting.sky)


def puddles(setting: Setting) -> Float[Tensor, " n"]:
    """Share of standing water: in hollows of what is level."""
    level = step(setting.rise, 0.9, 0.97) * setting.sure
    return level * step(setting.noise(6 * LEAF, 22), 0.2, 0.7) * wetness(setting)


def glossy(setting: Setting, after: Gaussians) -> Gaussians:
    """The scene with reflections on what is wet, of a studio where nothing is around; `after` has
    its colors, and may be dimmer."""
    surface, place = setting.found.surface, setting.found.place
    shown = (setting.found.seen > 0) * setting.found.trust
    wet = wetness(setting) * setting.sure * shown
    rows = (wet > LEAST_WET).nonzero().squeeze(-1)
    near = (surface.points - place.center).norm(dim=-1) < 0.4 * place.distance
    if not len(rows) or not bool(near.any()):
        return after
    maps = prefiltered(find_surroundings(setting.scene, near, place.up)).double()
    dim = _dimming(setting.scene, after, rows)
    standing = puddles(setting)[rows]
    rough = torch.lerp(
        torch.full_like(standing, ROUGH_WET), standing.new_tensor(ROUGH_PUDDLE), standing
    )
    views = torch.from_numpy(even_directions(VIEWS)).double()
    views = views[views @ place.up > 0.0]
    normals = surface.normals[rows]
    base = sh_to_color(after.sh[rows, 0].double()).clamp(0, 1) ** GAMMA
    gain = []
    for view in views:
        cosine = (normals @ view).clamp_min(0)
        mirrored = 2 * cosine[:, None] * normals - view
        fresnel = (WATER + (1 - WATER) * (1 - cosine) ** 5) * (1 - rough) * wet[rows]
        fresnel = fresnel * (cosine > 0)
        light = reflected(maps, mirrored, rough) * dim
        gain.append((base + fresnel[:, None] * light) ** (1 / GAMMA) - base ** (1 / GAMMA))
    return added(after, rows, views, gain)


def _dimming(before: Gaussians, after: Gaussians, rows: Tensor) -> float:
    """Light that is left, of the surroundings as of the wet surfaces."""
    old, new = (
        sh_to_color(each.sh[rows, 0].double()).clamp(0, 1) ** GAMMA for each in (before, after)
    )
    return float((new.mean() / old.mean().clamp_min(1e-6)).clamp(0.05, 1.0) ** 0.5)


def added(
    scene: Gaussians,
    rows: Tensor,
    views: Float[Tensor, "d 3"],
    gains: Iterable[Float[Tensor, "m 3"]],
) -> Gaussians:
    """The scene with display colors added to rows of it, for each direction it is seen from."""
    functions = basis(-views, DEGREE)
    square = functions.T @ functions + RIDGE * len(views) * torch.eye(functions.shape[1]).double()
    weights = torch.linalg.solve(square, functions.T)
    fitted = torch.zeros(len(rows), len(weights), 3).to(weights)
    for weight, gain in zip(weights.T, gains, strict=True):
        fitted += weight[:, None] * gain[:, None]
    sh = scene.detach().with_degree(max(scene.degree, DEGREE)).sh
    sh[rows, : functions.shape[1]] += fitted.to(sh)
    return replace(scene, sh=sh)


PAPER = (0.95, 0.94, 0.91)
"""Display color of paper."""
PALE, VIVID = 0.75, 1.6
"""Share of its darkness that a wash keeps, and the factor of its saturation."""


def watercolor(setting: Setting) -> ColorChange:
    """Washes: colors flow together, are vivid and pale, and pool at their edges."""
    around = setting.found.surface.smoothed(setting.colors, 6)
    brightest = around.amax(-1, keepdim=True)
    gray = around.mean(-1, keepdim=True)
    pale = (1 - PALE * (1 - brightest)) / brightest.clamp_min(0.05)
    vivid = ((gray + VIVID * (around - gray)) * pale).clamp(0, 1)
    thin = 0.25 + 0.13 * setting.noise(CLUMP / 2, 33) + 0.06 * setting.noise(LEAF / 2, 34)
    paper = torch.tensor(PAPER).double()
    pooled = 1 - 0.45 * _lines(setting)
    wash = torch.lerp(vivid, paper.expand_as(vivid), thin.clamp(0, 0.8)[:, None])
    color = (wash * pooled[:, None]).clamp(0, 1)
    return ColorChange(1.0, torch.ones_like(color), torch.ones(len(color)).double(), color)


def _lines(setting: Setting) -> Float[Tensor, " n"]:
    """How surely each Gaussian is on a line, in [0, 1]: darker than what is around it."""
    surface = setting.found.surface
    near, far = surface.smoothed(setting.luminance, 1), surface.smoothed(setting.luminance, 6)
    ratio = (near + 0.005) / (far + 0.005)
    return step(ratio ** (1 / GAMMA), 0.97, 0.78)


WHITE_SNOW, BLUE_SNOW = (1.0, 1.01, 1.03), (0.64, 0.74, 0.9)
"""Display colors of snow in full light, and in its shade."""
DRIFTS = 0.035
"""Standard deviation of the brightness of drifts."""
WINTER_SKY = (0.84, 0.87, 0.9)
SAND, DARK_SAND = (0.89, 0.75, 0.53), (0.62, 0.46, 0.3)
DESERT_SKY = (0.8, 0.83, 0.82)


def snow(setting: Setting) -> ColorChange:
    """Snow on what faces up and is open above; foliage is dusted, and steep sides stay."""
    soft = setting.noise(3 * LEAF, 1)
    lying = step(setting.rise + 0.1 * soft, 0.3, 0.62)
    dusted = step(setting.noise(LEAF, 2) + 0.8 * setting.rise, -0.5, 0.7)
    loose = torch.maximum(1 - setting.sure, setting.foliage)  # a hedge is no wall
    share = torch.lerp(lying, torch.maximum(lying, 0.85 * dusted), loose)
    share = share * step(setting.overhead, 0.12, 0.55)
    stems = setting.foliage * step(setting.noise(LEAF, 8), 0.2, 1.0)
    share = setting.found.surface.smoothed(share * (1 - 0.7 * stems), 1) * 0.97
    drifts = 1 + DRIFTS * setting.noise(3 * LEAF, 7)
    color = ramp_of((BLUE_SNOW, WHITE_SNOW), setting.lit(0.1, 0.7))
    color = color * (setting.detail(0.35) * drifts)[:, None]
    return _covered(setting, share, color, WINTER_SKY, 0.7, 0.9)


def frost(setting: Setting) -> ColorChange:
    """Thin white crystals: on leaves most, on what faces up, a little on all that is open."""
    grain = step(setting.noise(LEAF / 2, 3) + 0.6 * setting.noise(2 * LEAF, 4), -1.2, 1.2)
    leaves = 1 - 0.5 * setting.sure
    share = (0.35 + 0.65 * grain) * leaves * (0.35 + 0.65 * step(setting.rise, -0.1, 0.8))
    share = (1.5 * share * (0.3 + 0.7 * step(setting.overhead, 0.1, 0.6))).clamp_max(0.9)
    color = ramp_of(((0.5, 0.64, 0.8), (0.86, 0.93, 0.99)), setting.lit(0.15, 0.8))
    return _covered(setting, share, color * setting.detail(0.5)[:, None], WINTER_SKY, 0.7, 0.96)


def desert(setting: Setting) -> ColorChange:
    """Sand on the ground, dust on the rest; foliage dries to straw."""
    drift = step(setting.rise + 0.12 * setting.noise(4 * LEAF, 5), 0.45, 0.8)
    around = setting.found.surface.points - setting.found.place.center
    low = step(around @ setting.found.place.up / setting.found.place.distance, 0.05, -0.12)
    ground = drift * (0.35 + 0.6 * low) * (0.3 + 0.7 * setting.sure)
    dry = 0.85 * setting.foliage
    share = 1 - (1 - ground) * (1 - dry) * (1 - 0.16)
    color = ramp_of((DARK_SAND, SAND), setting.lit(0.2, 0.9)) * setting.detail(0.6)[:, None]
    ripples = 1 + 0.03 * setting.noise(LEAF, 6) * ground
    return _covered(setting, share, color * ripples[:, None], DESERT_SKY, 0.9, 1.0)


def _covered(
    setting: Setting,
    share: Float[Tensor, " n"],
    color: Float[Tensor, "n 3"],
    sky: tuple[float, float, float],
    saturation: float,
    factor: float,
) -> ColorChange:
    """A cover over a scene, before a sky of a color; colors are as displayed in a light of 1."""
    found = setting.found
    present = found.surface.smoothed(found.light)
    near = found.trust * found.seen
    mean = (near @ present) / near.sum().clamp_min(1e-12)
    present = mean + found.trust * (present - mean)
    sky_part = 0.85 * setting.sky
    veil = 1 - (1 - share) * (1 - sky_part)
    mixed = ((1 - sky_part) * share * present ** (1 / GAMMA))[:, None] * color
    mixed = mixed + sky_part[:, None] * torch.tensor(sky).double()
    tint = mixed / veil.clamp_min(1e-12)[:, None]
    ones = torch.full((len(share), 3), factor, dtype=torch.float64)
    return ColorChange(saturation, ones, veil, tint)


AUTUMN = ((0.58, 0.46, 0.16), (0.94, 0.69, 0.16), (0.97, 0.5, 0.1), (0.8, 0.22, 0.09),
          (0.55, 0.32, 0.15))  # fmt: skip
SPRING = ((0.42, 0.62, 0.2), (0.58, 0.74, 0.26), (0.66, 0.78, 0.36))
SUMMER = ((0.16, 0.4, 0.1), (0.24, 0.5, 0.12), (0.36, 0.56, 0.14))
BLOSSOM = ((1.0, 0.78, 0.87), (0.98, 0.6, 0.75))
"""Display colors of foliage in middle light."""
BRIGHTEST = 0.93
"""Display color that foliage does not pass."""


def autumn(setting: Setting) -> ColorChange:
    """Leaves from green gold over orange to brown, by clump and by leaf; lawns fade to straw."""
    turned = 0.5 + 0.25 * setting.noise(2 * CLUMP, 11) + 0.18 * setting.noise(LEAF, 12)
    lawn = setting.sure * step(setting.rise, 0.7, 0.9)
    turned = torch.lerp(turned, 0.15 * turned, lawn)
    return _leaves(setting, ramp_of(AUTUMN, turned), 0.96)


def spring(setting: Setting) -> ColorChange:
    """Fresh leaves, and blossoms on some of the bushes."""
    fresh = ramp_of(SPRING, 0.5 + 0.3 * setting.noise(CLUMP, 13) + 0.1 * setting.noise(LEAF, 14))
    petals = step(setting.noise(3 * CLUMP, 15), -0.1, 0.15)  # finer ones mix to brown
    petals = petals * (1 - step(setting.found.surface.confidence, 0.93, 0.99))
    pink = ramp_of(BLOSSOM, 0.5 + 0.4 * setting.noise(CLUMP, 18))
    return _leaves(setting, torch.lerp(fresh, pink, petals[:, None]), 0.96, petals)


def summer(setting: Setting) -> ColorChange:
    """Full, deep green leaves."""
    deep = ramp_of(SUMMER, 0.5 + 0.3 * setting.noise(CLUMP, 19) + 0.1 * setting.noise(LEAF, 20))
    return _leaves(setting, deep, 0.7)


def ramp_of(
    colors: tuple[tuple[float, float, float], ...], at: Float[Tensor, " n"]
) -> Float[Tensor, "n 3"]:
    """Colors along a ramp, from 0 to 1."""
    table = torch.tensor(colors, dtype=torch.float64)
    place = at.clamp(0, 1) * (len(table) - 1)
    low = place.long().clamp_max(len(table) - 2)
    return torch.lerp(table[low], table[low + 1], (place - low)[:, None])


def _leaves(
    setting: Setting,
    color: Float[Tensor, "n 3"],
    strength: float,
    light: Float[Tensor, " n"] | None = None,
) -> ColorChange:
    """Foliage in other colors, as bright against each other as its leaves are; where `light` is 1,
    as bright as the color is."""
    leaves = setting.foliage
    middle = setting.luminance[leaves > 0.5].median() if bool((leaves > 0.5).any()) else 0.2
    shade = ((setting.luminance + 0.005) / (middle + 0.005)).clamp(0.05, 2.2) ** (1 / GAMMA)
    if light is not None:
        shade = torch.lerp(shade, shade.clamp_min(1.0), light)
    lit = (color * shade[:, None]).clamp_max(BRIGHTEST)
    ones = torch.ones(len(leaves), 3, dtype=torch.float64)
    return ColorChange(1.0, ones, strength * leaves, lit)


SOAKED = 0.62
"""Share of its light that soaked stone or soil loses: water fills the pores that scatter it."""
CAUSTIC = 0.55
"""Gain of light where waves focus it."""


def wet(setting: Setting) -> ColorChange:
    """Soaked surfaces: darker and more saturated; standing water darkest."""
    soaked = wetness(setting) * (1 - 0.6 * setting.foliage)
    linear = 1 - SOAKED * soaked - 0.2 * puddles(setting)
    factor = linear.clamp_min(0.1) ** (1 / GAMMA)
    return _times(1.12, factor)


def caustics(setting: Setting) -> ColorChange:
    """A net of light on what faces up, as below waves."""
    size = 5 * LEAF
    ridges = torch.exp(-6 * setting.noise(size, 23).abs()) + torch.exp(
        -6 * setting.noise(0.8 * size, 24).abs()
    )
    net = CAUSTIC * ridges * step(setting.rise, 0.0, 0.8) * setting.found.trust
    factor = (0.85 + net) ** (1 / GAMMA)
    return _times(1.0, factor)


def _times(saturation: float, factor: Float[Tensor, " n"]) -> ColorChange:
    """Display colors, more or less saturated, times a factor."""
    colors = factor[:, None].expand(-1, 3)
    return ColorChange(saturation, colors, torch.zeros_like(factor), torch.zeros_like(colors))


Effect = Callable[[Setting], ColorChange]
Sheen = Callable[[Setting, Gaussians], Gaussians]


@dataclass(frozen=True)
class Scenery:
    """A weather or season."""

    light: LightSetup | None
    """Light that it comes in; None: the present light."""
    effect: Effect
    """Change of surfaces, of the scene in its present light."""
    sheen: Sheen | None = None
    """Adds colors that depend on the view, to the scene after the effects."""


def _scenery(name: str, row: Row) -> Scenery:
    """A row of the table; its functions are those of this module."""
    light, effect, sheen = (row.values.get(key) for key in ("light", "effect", "sheen"))
    found = {**SKIES, **LIGHTS}[light.replace("_", " ")] if light else None
    return Scenery(found, globals()[effect or name], globals()[sheen] if sheen else None)


SCENERIES = {name: _scenery(name, row) for name, row in TABLE["weathers"].items()}
"""Weather and seasons by the names that sentences give them."""


@cached_per_scene
def in_scenery(
    scene: Gaussians,
    name: str,
    cameras: Sequence[Camera],
    seen: Float[Tensor, " n"] | None = None,
    inside: Bool[Tensor, " n"] | None = None,
) -> Gaussians:
    """The scene in a weather or season; Gaussians that are not `inside` keep their coefficients.

    Arguments as of gsedit.change.light.relight.relit. Raises UsageError for an unknown name.
    """
    if name not in SCENERIES:
        raise UsageError(f"there is no scenery {name!r}: choose one of {', '.join(SCENERIES)}")
    scenery = SCENERIES[name]
    setting = Setting(scene, survey(scene, cameras, seen), cameras)
    after = scenery.effect(setting).applied(scene)
    if scenery.light is not None:
        after = relit_by(setting.found, after, scenery.light)
    if scenery.sheen is not None:
        after = scenery.sheen(setting, after)
    return only_inside(scene, after, inside)
