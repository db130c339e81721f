"""Gaussians that masks or edits show, from noisy values of single Gaussians. `n` Gaussians."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.regions.graph import Neighbors, neighbors, smooth
from gsedit.regions.lift import Lifted
from rasterizer.scene import Gaussians

SMOOTHING_WEIGHT = 10.0
"""Weight of a neighbor's value against a Gaussian's own, where all views see it well."""
MIN_SEEN_PIXELS = 1e-3
"""Pixels, in all views together: what contributes less is not seen."""
MAX_OUTSIDE_SHARE = 0.25
"""Largest change outside, as a share of that inside: editors change surroundings a little."""
BINS = 256
"""Bins of the histogram of values in [0, 1] that a threshold is found in."""
MIN_MASK_MEAN = 0.5
"""Least mean of masks inside: they are drawn by a person, so there is nothing to find out."""


def find_changed(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """Find the Gaussians that an edit changes, from the lifted size of the change.

    None where that is everything: outside, the change must be at most `MAX_OUTSIDE_SHARE` of that
    inside.
    """
    graph = neighbors(scene)
    scale = (
        float(lifted.mean[lifted.weight > MIN_SEEN_PIXELS].quantile(0.95)) if len(scene) else 0.0
    )
    if scale <= 0:
        return None
    values = smoothed(replace(lifted, mean=lifted.mean / scale), graph)
    inside = values > otsu(values, lifted.weight)
    means = [
        float((lifted.weight * values)[part].sum() / lifted.weight[part].sum().clamp_min(1e-9))
        for part in (inside, ~inside)
    ]
    return inside if means[1] < MAX_OUTSIDE_SHARE * means[0] else None


def find_drawn(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"]:
    """Find the Gaussians in lifted masks; those that no mask's view sees follow their neighbors."""
    return smoothed(lifted, neighbors(scene)) > MIN_MASK_MEAN


def smoothed(lifted: Lifted, graph: Neighbors) -> Float[Tensor, " n"]:
    """Values of which those are sure that many pixels have a part in."""
    seen = lifted.weight > MIN_SEEN_PIXELS
    typical = lifted.weight[seen].median() if seen.any() else torch.tensor(1.0)
    confidence = lifted.weight / (lifted.weight + typical)
    return smooth(lifted.mean, confidence, graph, SMOOTHING_WEIGHT).clamp(0, 1)


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
