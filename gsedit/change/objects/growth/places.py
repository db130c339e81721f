"""Growths, rows of gsedit/words/looks/growths.txt: where they lie, how thick, of what made.

`m` places on a surface, `n` Gaussians of the scene; shares are in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.change.light.relight import Surface, received, step
from gsedit.change.objects.placing.daylight import Sun, shadow_of
from gsedit.change.scenery.effects import Setting, ramp_of
from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.framing import weighted_quantile
from gsedit.scene.neighbors import k_nearest
from gsedit.toolkit.grade import GAMMA
from gsedit.views.noise import noise
from gsedit.words.names import TABLE, Row

EVEN = 0.5
"""Share of an even sky in the light: the present one is told from colors that are not its own."""
BRIGHT, WELL_LIT, DARKEST = 0.98, 0.45, 0.1
"""Rank among what is seen of what is bright, its linear luminance in a picture that is lit well,
and the least exposure: in a dark picture nothing new is bright."""
BEST, LEAST_BEST = 0.9, 0.6
"""Rank of the light on places that counts as open, and the least that does: haze and walls around
dim all of a part alike."""
BOUNCED = 0.2
"""Share of light that comes from what is around, wherever it is."""
Rgb = tuple[float, float, float]
TORN = (0.85, 0.97)
"""Length of the mean normal around what is no surface to grow on, and of what is."""
NEAREST = 6
"""Gaussians around a place that say what is known of it."""


@dataclass(frozen=True, eq=False)
class Site:
    """A part of a scene that things grow on."""

    setting: Setting
    rows: Int[Tensor, " k"]
    """Gaussians of the part."""
    size: float
    """Its extent, world units: thicknesses are shares of it."""
    sun: Sun | None = None
    """Sun that is told from the shadows around it."""
    whole: bool = False
    """Whether it is all of the scene, floaters and far leaves among it."""

    @cached_property
    def exposure(self) -> float:
        """Factor, at most 1, of light in a picture that is dark."""
        seen = self.setting.found.seen
        bright = weighted_quantile(self.setting.luminance[:, None], seen, BRIGHT)
        return min(max(float(bright) / WELL_LIT, DARKEST), 1.0)

    @cached_property
    def firm(self) -> Float[Tensor, " n"]:
        """How much of a surface the scene is: little among petals, where normals disagree."""
        surface = self.setting.found.surface
        return step(surface.smoothed(surface.normals, 3).norm(dim=-1), *TORN)

    @property
    def up(self) -> Float[Tensor, "3"]:
        return self.setting.found.place.up

    def spots(self, points: Float[Tensor, "m 3"], normals: Float[Tensor, "m 3"]) -> Spots:
        """Places with these normals, and the part's Gaussians nearest to each."""
        means = self.setting.found.surface.points[self.rows]
        near = k_nearest(means.numpy(), points.numpy(), min(NEAREST, len(means)))[1]
        return Spots(self, points, normals, self.rows[torch.from_numpy(near)])


@dataclass(frozen=True, eq=False)
class Spots:
    """Places on a surface."""

    site: Site
    points: Float[Tensor, "m 3"]
    normals: Float[Tensor, "m 3"]
    near: Int[Tensor, "m q"]
    """Gaussians of the scene nearest to each."""

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: Tensor) -> Spots:
        return Spots(self.site, self.points[rows], self.normals[rows], self.near[rows])

    def mean(self, values: Float[Tensor, "n ..."]) -> Float[Tensor, "m ..."]:
        """Means of what is known of the Gaussians nearest to each place."""
        return values[self.near].mean(1)

    @property
    def rise(self) -> Float[Tensor, " m"]:
        """Cosine between the normal and up."""
        return self.normals @ self.site.up

    @property
    def overhead(self) -> Float[Tensor, " m"]:
        """Share of the sky overhead that is open."""
        return self.mean(self.site.setting.overhead)

    @property
    def openness(self) -> Float[Tensor, " m"]:
        """Share of the whole sky that is open: low in crevices and under things."""
        return self.mean(self.site.setting.found.surface.open.mean(1))

    @property
    def height(self) -> Float[Tensor, " m"]:
        """Height over the lowest of the part's surface, in its size."""
        heights = self.points @ self.site.up
        return (heights - heights.min()) / self.site.size if len(self) else heights

    @property
    def earthly(self) -> Float[Tensor, " m"]:
        """How surely each place is near and no sky."""
        setting = self.site.setting
        return self.mean(setting.found.trust * (1 - setting.sky))

    def noise(self, size: float, seed: int) -> Float[Tensor, " m"]:
        """Noise of mean 0 and deviation 1 whose features have a size, in that of the part."""
        return noise(self.points / (size * self.site.size), seed)

    def light(self) -> Float[Tensor, " m"]:
        """Present light on each place, about 1 where it is level and open."""
        found = self.site.setting.found
        old = found.surface
        here = Surface(
            self.points, self.normals, torch.ones(len(self)).double(), self.near, old.directions,
            self.mean(old.open), old.occluders, old.place,
        )  # fmt: skip
        even = received(here)[:, :-1].sum(1)
        if self.site.sun is None:
            present = torch.lerp(found.falling_on(here), even, EVEN)
        else:
            present = self._in(self.site.sun, even)
        best = min(max(float(present.quantile(BEST)), LEAST_BEST), 1.0) if len(present) else 1.0
        present = torch.lerp(present / best, torch.ones_like(present), BOUNCED)
        near = found.trust * found.seen
        usual = (near @ found.light) / near.sum().clamp_min(1e-12)
        return self.site.exposure * (usual + self.mean(found.trust) * (present - usual))

    def _in(self, sun: Sun, even: Float[Tensor, " m"]) -> Float[Tensor, " m"]:
        """Light of a sun and of an even sky, 1 where it is level and open."""
        strength = float(sun.strength @ torch.from_numpy(LUMINANCE))
        body = self.site.setting.scene[self.site.rows]
        hidden = shadow_of(body, self.points, sun.direction)
        direct = (self.normals @ sun.direction).clamp_min(0) * (1 - hidden)
        level = 1 + strength * float(sun.direction @ self.site.up)
        return (even + strength * direct) / level

    def shaded(self, shade: Rgb, lit: Rgb, light: Float[Tensor, " m"]) -> Float[Tensor, "m 3"]:
        """Display colors of a surface that is of one color in the shade, of another in light."""
        colors = ramp_of((shade, lit), step(light, 0.35, 0.95))
        return colors * (light.clamp_min(0) ** (1 / GAMMA))[:, None]


def snowy(spots: Spots) -> Float[Tensor, " m"]:
    """Snow: on places that face up and are open above."""
    soft = 0.07 * spots.noise(0.06, 1) + 0.04 * spots.noise(0.02, 9)
    lying = step(spots.rise + soft, 0.5, 0.75)
    blown = spots.overhead * (1 + 3 * soft)  # below a roof: its border is no line
    return lying * step(blown, 0.1, 0.4) * spots.earthly


def dusty(spots: Spots) -> Float[Tensor, " m"]:
    """Dust: on places that face up, under a roof too, and in hollows; most on level ones."""
    soft = 0.15 * spots.noise(0.03, 2)
    lying = step(spots.rise + soft, 0.1, 0.6)
    hollows = step(spots.openness, 0.7, 0.3) * step(spots.rise, -0.3, 0.2)
    return torch.maximum(lying, 0.8 * hollows) * spots.earthly


def mossy(spots: Spots) -> Float[Tensor, " m"]:
    """Moss: over all that faces up or outward, in clumps that thin out downward; into crevices and
    low places farther, and on none that faces down."""
    damp = 0.3 * step(spots.openness, 0.75, 0.3) + 0.2 * step(spots.height, 0.35, 0.02)
    clumps = spots.rise + damp + 0.25 * spots.noise(0.09, 3) + 0.12 * spots.noise(0.03, 4)
    return (
        step(clumps, -0.1, 0.35)
        * step(spots.rise, -0.6, -0.2)
        * spots.earthly
        * spots.mean(spots.site.firm)
    )


def icy(spots: Spots) -> Float[Tensor, " m"]:
    """Ice: a glaze on places that are open above and not turned down."""
    soft = 0.12 * spots.noise(0.05, 5)
    return step(spots.rise + soft, 0.0, 0.35) * step(spots.overhead, 0.1, 0.4) * spots.earthly


def littered(spots: Spots) -> Float[Tensor, " m"]:
    """Leaves: on places that are about level and open above, in drifts."""
    level = step(spots.rise, 0.7, 0.9)
    drifts = 0.75 + 0.25 * spots.noise(0.2, 6)
    return (level * step(spots.overhead, 0.1, 0.4) * drifts).clamp(0, 1) * spots.earthly


LEAST, MOST = 0.1, 5.0
"""Range of the factor of a usual thickness."""


@dataclass(frozen=True)
class Growth:
    """Something that lies or grows on surfaces; lengths are shares of what it is on."""

    where: Callable[[Spots], Float[Tensor, " m"]]
    body: Literal["layer", "tufts", "leaves"]
    thickness: float
    """Height over the surface, far from the edges; of leaves, their length."""
    grain: float
    """Distance of its Gaussians along the surface, if there are not too many."""
    shade: Rgb
    """Display color in the shade, for a light of 1; above 1 it outshines haze before it."""
    lit: Rgb
    """Display color in the light."""
    requirement: str
    """Surface that it needs, as the error says it: "nothing inside ..."."""
    opacity: float = 0.985
    mottle: float = 0.02
    """Standard deviation of the brightness from Gaussian to Gaussian."""
    edge: float = 0.5
    """Least share of a place at which it lies there."""
    around: bool = False
    """Whether it grows on walls too; else only on what is seen from above."""
    hides: bool = True
    """Whether the Gaussians under it take its color."""
    each: int = 1
    """Gaussians a pixel, at most."""
    smooth: int = 6
    """Rounds of smoothing of the surface under it, over a pixel each."""
    weather: str | None = None
    """Scenery of what it does not reach, as far trees, where it is everywhere."""


def _growth(row: Row) -> Growth:
    """A row of the table; the function of `where` is of this module."""
    values = dict(row.values, where=globals()[row.values["where"]])
    for name, more in row.parts:
        values |= more or {"requirement": name.removeprefix("needs ")}
    for counted in {"each", "smooth"} & values.keys():
        values[counted] = int(values[counted])
    return Growth(**values)


GROWTHS = {name: _growth(row) for name, row in TABLE["growths"].items()}
"""Growths by the names that sentences give them."""
FALLS = {growth.weather: name for name, growth in GROWTHS.items() if growth.weather}
"""Growths that come with a weather or season, by its name."""


def growth_of(name: str, amount: float) -> Growth:
    """The growth of a name. Raises UsageError for an unknown one, or an amount out of range."""
    if name not in GROWTHS:
        raise UsageError(f"there is no growth {name!r}: choose one of {', '.join(GROWTHS)}")
    if not LEAST <= amount <= MOST:
        raise UsageError(
            f"{name} {amount:g} times as thick as usual is out of range: say {LEAST:g} to {MOST:g}"
        )
    return GROWTHS[name]
