"""Light that a scene was captured in, roughly: surfaces, open sky, and weights of its directions.

Colors are surface times light. Gaussians of one hue are taken for one surface; what then is left of
their luminance is explained by light from the sky's directions, at least 0 each, past what hides
them. It is the light on each Gaussian of a scene, of one color; the light around one place, from
all directions and in color, is another question: gsedit.views.surroundings.
`n` Gaussians, `d` directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64, Int, Int64
from torch import Tensor

from gsedit.scene.cache import cached_per_scene
from gsedit.scene.color_space import LUMINANCE, lab_of_srgb, linear_of_srgb
from gsedit.scene.neighbors import nearest
from gsedit.views.normals import estimate_normals, neighbor_means, visible_area
from gsedit.views.place import Place, place_of
from gsedit.views.shadows import casters, open_share, sky_directions
from gsedit.views.surroundings import light_near
from rasterizer.camera import Camera
from rasterizer.numerics import sh_to_color
from rasterizer.scene import Gaussians

SKY_REACH = 0.5
"""Distance, in the radius, up to which something hides the sky: farther off, captures hold
ceilings and haze."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Gaussians near the subject as light finds them, a row each."""

    points: Float[Tensor, "n 3"]
    """Centers in world units, float64."""
    normals: Float[Tensor, "n 3"]
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
    normals = estimate_normals(scene, cameras)
    unit = normals.directions.double()
    points = scene.means.detach().double()
    directions = sky_directions(place)
    occluders = casters(scene, place)
    reach = SKY_REACH * place.radius
    seen = open_share(occluders, place, points, directions, normals=unit, reach=reach)
    near = torch.from_numpy(nearest(scene.means.detach().float().numpy())[1])
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
INDIRECT = 0.25
"""Share of light that comes from everywhere else."""


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
    light, weights = estimate_present(surface, colors, (seen * trust).numpy(), sky)
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
    surface: Surface,
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
    fitted = _fitted(design, luminance, _hues(shown), np.sqrt(seen[rows]))
    weights = torch.from_numpy(fitted)
    light = light_received @ weights
    middle = float(light[torch.from_numpy(rows)].median().clamp_min(1e-6))
    return light.clamp(LEAST * middle, MOST * middle), weights


def _hues(colors: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, " m"]:
    squares = np.floor(lab_of_srgb(colors)[:, 1:] / HUE_STEP).astype(np.int64)
    return np.unique(squares, axis=0, return_inverse=True)[1].reshape(-1)


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
    return weights
