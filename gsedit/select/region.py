"""The Gaussians that an edit may change: as pictures, as a file, and found from values in pictures.

A picture is linear in the colors of the Gaussians, and the factor of a Gaussian's color in a
pixel is its blending weight. The transpose of that map gives the sum of a map's values, weighted by
what each Gaussian contributes to each pixel. `n` Gaussians; pictures and maps of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_matrix
from torch import Tensor

from gsedit.formats.flags import write_flags
from gsedit.select.surfaces import neighbors, smooth
from gsedit.views.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.numerics import color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians

TINT = (1.0, 0.1, 0.6)
"""Color of the inside in pictures for a person, which few captures have."""
TINT_STRENGTH = 0.55


@dataclass(frozen=True, eq=False)
class Region:
    """The Gaussians that an edit may change."""

    inside: Bool[Tensor, " n"]
    """The Gaussians that may change."""
    note: str = ""
    """How it was found, for a person."""
    how: str = ""
    """The expression that finds it again (gsedit.select.where)."""
    sure: float = 1.0
    """Share of what was seen, drawn or clicked that says so, in [0, 1]."""
    is_least: bool = False
    """Whether a place was clicked once more than there are parts in each other."""

    def __str__(self) -> str:
        return f"{self.note}; {int(self.inside.sum()):,} of {len(self.inside):,} Gaussians"

    @property
    def is_all(self) -> bool:
        """Whether nothing is outside."""
        return bool(self.inside.all())


def everything(scene: Gaussians) -> Region:
    """The region of all Gaussians."""
    return Region(torch.ones(len(scene), dtype=torch.bool), "all", "all()")


@torch.no_grad()
def coverage(region: Region, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w"]:
    """The share of each pixel that comes from the region's Gaussians: the sum of their blending
    weights, in [0, 1]. What is left comes from the other Gaussians and the background."""
    if region.is_all:
        return torch.ones(camera.height, camera.width, dtype=scene.means.dtype)
    return render(in_one_color(scene, region.inside), camera).color[..., 0]


def in_one_color(scene: Gaussians, values: Bool[Tensor, " n"] | Float[Tensor, " n"]) -> Gaussians:
    """The scene in greys from every direction: `values` in [0, 1], one a Gaussian."""
    grey = color_to_sh(values.to(scene.sh))
    return replace(scene, sh=grey[:, None, None].expand(-1, 1, 3))


def tinted(
    scene: Gaussians, inside: Bool[Tensor, " n"], color: tuple[float, float, float] = TINT
) -> Gaussians:
    """The scene with the Gaussians inside tinted, for a person to look at; colors in [0, 1]."""
    sh = scene.sh.clone()
    sh[inside] *= 1 - TINT_STRENGTH
    sh[inside, 0] += TINT_STRENGTH * color_to_sh(torch.tensor(color)).to(sh)
    return replace(scene, sh=sh)


def save_region(region: Region, path: Path | str, *, overwrite: bool = False) -> None:
    """Write one flag a Gaussian, in the order of the scene's file: a .npy file of booleans."""
    write_flags(region.inside.cpu().numpy(), path, overwrite=overwrite)


@dataclass(frozen=True, eq=False)
class Lifted:
    """Values of pictures, lifted to each Gaussian."""

    mean: Float[Tensor, " n"]
    """Mean of the maps' values, weighted by the Gaussian's contributions; 0 in no view."""
    weight: Float[Tensor, " n"]
    """Contribution of the Gaussian to all views, pixels."""


def lift(
    scene: Gaussians, cameras: Sequence[Camera], maps: Sequence[Float[Tensor, "h w"]]
) -> Lifted:
    """Means over all views of maps with one value a pixel; a map has its camera's size."""
    sums = scene.means.new_zeros(len(scene), 3)
    for camera, values in zip(cameras, maps, strict=True):
        ones = torch.ones_like(values)
        stacked = torch.stack((values, ones, ones), -1)
        sums += color_weights(scene, camera).back(stacked.to(sums))
    total, weight, _ = sums.unbind(-1)
    return Lifted(total / weight.clamp_min(1e-9), weight)


SILHOUETTE = 0.5
"""Share of a pixel that the inside gives, from which the pixel is in its silhouette; and share of a
Gaussian's pixels that must be in it."""


@torch.no_grad()
def within_silhouette(
    scene: Gaussians, cameras: Sequence[Camera], inside: Bool[Tensor, " n"]
) -> Bool[Tensor, " n"]:
    """The Gaussians inside without those that are seen mostly beyond the silhouette of all.

    These are wide or stray ones, whose color would show far outside. What no view shows stays.
    """
    colors = inside.to(scene.means)[:, None].expand(-1, 3).contiguous()
    sums = scene.means.new_zeros(len(scene), 3)
    for camera in cameras:
        weights = color_weights(scene, camera)
        shown = (weights.picture(colors)[..., :1] > SILHOUETTE).to(sums)
        sums += weights.back(torch.cat((shown, torch.ones_like(shown), shown), -1))
    return inside & (sums[:, 0] >= SILHOUETTE * sums[:, 1])


CUT_VIEWS, CUT_PIXELS = 8, 320
"""Most views in which objects are cut out, and their longer side, pixels."""


def cut_out(
    scene: Gaussians, cameras: Sequence[Camera], inside: Bool[Tensor, " n"]
) -> Bool[Tensor, " n"]:
    """An object without what sticks out of its silhouette in some of the views, which would show
    far outside of it: 24 dB instead of 39 on the bear. All of it where nothing else is left."""
    some = [cameras[i].fitted(CUT_PIXELS) for i in evenly_spaced(len(cameras), CUT_VIEWS)]
    cut = within_silhouette(scene, some, inside)
    return cut if cut.any() else inside


MIN_SEEN_PIXELS = 1e-3
"""Pixels, in all views together: what contributes less is not seen."""
BINS = 256
"""Bins of the histogram of values in [0, 1] that a threshold is found in."""


def find_drawn(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"]:
    """Find the Gaussians in lifted masks; those that no mask's view sees follow their neighbors."""
    return smoothed(lifted, neighbors(scene)) > 0.5


def smoothed(lifted: Lifted, graph: csr_matrix) -> Float[Tensor, " n"]:
    """Values of which those are sure that many pixels have a part in."""
    seen = lifted.weight > MIN_SEEN_PIXELS
    typical = lifted.weight[seen].median() if seen.any() else torch.tensor(1.0)
    confidence = lifted.weight / (lifted.weight + typical)
    return smooth(lifted.mean, confidence, graph, strength=10.0).clamp(0, 1)


def otsu(values: Float[Tensor, " n"], weights: Float[Tensor, " n"]) -> float:
    """The threshold that splits values in [0, 1] into two classes of least variance (Otsu 1979).

    Equivalently, of the greatest variance between the classes' means. Where several thresholds are
    equally good (nothing lies between the classes), the middle one.
    """
    bins = (values.clamp(0, 1) * BINS).long().clamp_max(BINS - 1)
    histogram = torch.zeros(BINS, dtype=torch.float64)
    histogram.index_add_(0, bins, weights.double())
    centers = (torch.arange(BINS, dtype=torch.float64) + 0.5) / BINS
    below = histogram.cumsum(0)[:-1]
    above = histogram.sum() - below
    first = (histogram * centers).cumsum(0)
    mean_below = first[:-1] / below.clamp_min(1e-12)
    mean_above = (first[-1] - first[:-1]) / above.clamp_min(1e-12)
    between = below * above * (mean_above - mean_below).square()
    best = (between >= between.amax() * (1 - 1e-9)).nonzero().squeeze(-1)
    return (float(best.float().mean()) + 1) / BINS
