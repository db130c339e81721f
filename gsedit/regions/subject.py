"""The Gaussians of one object, from noisy values of single Gaussians. `n` Gaussians."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.regions.connect import Neighbours, connected_part, neighbours, smooth
from gsedit.regions.lift import Lifted
from gsedit.regions.threshold import otsu
from rasterizer.scene import Gaussians

SMOOTHING = 10.0
"""Weight of a neighbour's value against a Gaussian's own, where all views see it well."""
IN_SIGHT = 1e-3
"""Pixels, in all views together: what contributes less is not seen."""
FAINT = 0.25
"""Of the change inside: what an editor does to the surroundings without being asked."""
DRAWN = 0.5
"""Least mean of masks inside: they are drawn by a person, so there is nothing to find out."""


def find_subject(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """The connected object that the cameras look at, from lifted probabilities of the subject.

    None where there is no such object: no part of the scene is more probably it than not.
    """
    graph = neighbours(scene)
    values = _smoothed(lifted, graph)
    selected = values > otsu(values, lifted.weight)
    part = connected_part(selected, lifted.central * values, graph)
    weight = lifted.weight[part]
    if not part.any() or float((weight * values[part]).sum()) < 0.5 * float(weight.sum()):
        return None
    return part


def find_changed(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """What an edit changes, from the lifted size of the change; None where that is everything.

    The change must be of two kinds: outside at most `FAINT` of what it is inside.
    """
    graph = neighbours(scene)
    scale = float(lifted.mean[lifted.weight > IN_SIGHT].quantile(0.95)) if len(scene) else 0.0
    if scale <= 0:
        return None
    values = _smoothed(replace(lifted, mean=lifted.mean / scale), graph)
    inside = values > otsu(values, lifted.weight)
    means = [
        float((lifted.weight * values)[part].sum() / lifted.weight[part].sum().clamp_min(1e-9))
        for part in (inside, ~inside)
    ]
    return inside if means[1] < FAINT * means[0] else None


def find_drawn(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"]:
    """What masks select, from lifted masks; what no mask's view sees follows its neighbours."""
    return _smoothed(lifted, neighbours(scene)) > DRAWN


def _smoothed(lifted: Lifted, graph: Neighbours) -> Float[Tensor, " n"]:
    """Values of which those are sure that many pixels have a part in."""
    seen = lifted.weight > IN_SIGHT
    typical = lifted.weight[seen].median() if seen.any() else torch.tensor(1.0)
    confidence = lifted.weight / (lifted.weight + typical)
    return smooth(lifted.mean, confidence, graph, SMOOTHING).clamp(0, 1)
