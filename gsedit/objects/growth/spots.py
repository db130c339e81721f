"""Places on a surface that something may grow on, and what is known of each. `m` places."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.light.color_change import step
from gsedit.light.present import Surface, received
from gsedit.objects.placing.daylight import Sun, shadow_of
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quantiles import weighted_quantile
from gsedit.scenery.setting import Setting
from gsedit.surface.noise import noise
from gsedit.toolkit.grade import GAMMA
from rasterizer.numerics import AUTO, Execution

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
    execution: Execution = AUTO

    @cached_property
    def exposure(self) -> float:
        """Factor, at most 1, of light in a picture that is dark."""
        seen = self.setting.found.seen
        bright = weighted_quantile(self.setting.luminance[:, None], seen, BRIGHT)
        return min(max(float(bright) / WELL_LIT, DARKEST), 1.0)

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
        strength = float(sun.strength @ torch.from_numpy(LUMINANCE / LUMINANCE.sum()))
        body = self.site.setting.scene[self.site.rows]
        hidden = shadow_of(body, self.points, sun.direction, self.site.execution)
        direct = (self.normals @ sun.direction).clamp_min(0) * (1 - hidden)
        level = 1 + strength * float(sun.direction @ self.site.up)
        return (even + strength * direct) / level

    def shaded(
        self, shade: tuple[float, ...], lit: tuple[float, ...], light: Float[Tensor, " m"]
    ) -> Float[Tensor, "m 3"]:
        """Display colors of a surface that is of one color in the shade, of another in light."""
        dark, bright = torch.tensor(shade).double(), torch.tensor(lit).double()
        share = step(light, 0.35, 0.95)[:, None]
        return (dark + share * (bright - dark)) * (light.clamp_min(0) ** (1 / GAMMA))[:, None]
