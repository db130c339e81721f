"""Parts of a scene that weather and seasons change: foliage, what faces up, the ground, the sky.

`n` Gaussians; shares are in [0, 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.change.light.present import Survey
from gsedit.change.light.relight import sky_share, step
from gsedit.scene.color_space import LUMINANCE, lab_of_srgb, linear_of_srgb
from gsedit.scene.picture import render_picture
from gsedit.select.region import lift
from gsedit.toolkit.grade import GAMMA
from gsedit.views.dataset import evenly_spaced
from gsedit.views.noise import noise
from rasterizer.camera import Camera
from rasterizer.numerics import sh_to_color
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
