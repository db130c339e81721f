"""The Gaussians of one object, from noisy values of single Gaussians. `n` Gaussians."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.regions.graph import Neighbors, connected_part, neighbors, parts, smooth
from gsedit.regions.lift import Lifted
from gsedit.regions.support import extent_of, find_support, within
from gsedit.scene.quantiles import weighted_quantile
from rasterizer.scene import Gaussians

SMOOTHING_WEIGHT = 10.0
"""Weight of a neighbor's value against a Gaussian's own, where all views see it well."""
MIN_SEEN_PIXELS = 1e-3
"""Pixels, in all views together: what contributes less is not seen."""
MAX_OUTSIDE_SHARE = 0.25
"""Largest change outside, as a share of that inside: editors change surroundings a little."""
BINS = 256
"""Bins of the histogram of values in [0, 1] that a threshold is found in."""
BOX_TAIL = 0.005
"""Share of what is likely the subject that may lie beyond each side of its box: stray Gaussians."""
BOX_MARGIN = 0.25
"""Width of the surroundings around the box, of its diagonal."""
SUPPORTED_SHARE = 0.35
"""Share of the threshold that is enough above the support, where no ground can be taken for it."""
MOST_GROWTH = 2.0
"""Largest gain of pixels by what is only likely: beyond, rough ground is taken for feet. Three fits
of a bear gain 1.23, 1.33 and 1.60 by its paws."""
LOOSE_MEAN = 0.7
"""Least mean probability of a part that is not connected with the rest of the subject."""
LOOSE_DISTANCE = 0.25
"""Largest distance of such a part from the rest, of the subject's extent."""
LOOSE_WEIGHT = 0.01
"""Least share of the main part's pixels that such a part fills: less is a stray Gaussian."""
MIN_MASK_MEAN = 0.5
"""Least mean of masks inside: they are drawn by a person, so there is nothing to find out."""


def find_subject(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """The connected object that the cameras look at, from lifted probabilities of the subject.

    It ends where it touches the plane that it stands on, if there is one: above that, it takes
    less to be of the subject. None where there is no such object: no part of the scene is more
    probably it than not.
    """
    near = _looked_at(scene, lifted)
    rows = near.nonzero().squeeze(-1)
    part, here = scene[rows], _rows(lifted, rows)
    graph = neighbors(part)
    values = smoothed(here, graph)
    threshold = otsu(values, here.weight)
    core = connected_part(values > threshold, here.central * values, graph)
    weight = here.weight[core]
    if not core.any() or float((weight * values[core]).sum()) < 0.5 * float(weight.sum()):
        return None
    inside = torch.zeros(len(scene), dtype=torch.bool)
    inside[rows] = _whole(part, here, graph, core, threshold)
    return inside


def _looked_at(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"]:
    """The Gaussians in and around the box of what is likely the subject."""
    likely = lifted.mean > otsu(lifted.mean, lifted.weight)
    if not likely.any():
        return torch.ones_like(likely)
    points, score = scene.means.detach()[likely].double(), (lifted.central * lifted.mean)[likely]
    low, high = (
        weighted_quantile(points, score.double(), share) for share in (BOX_TAIL, 1 - BOX_TAIL)
    )
    margin = BOX_MARGIN * float((high - low).norm())
    return ((scene.means >= low - margin) & (scene.means <= high + margin)).all(1)


def _rows(lifted: Lifted, rows: Int[Tensor, " m"]) -> Lifted:
    return Lifted(lifted.mean[rows], lifted.weight[rows], lifted.central[rows])


def _whole(
    scene: Gaussians,
    lifted: Lifted,
    graph: Neighbors,
    core: Bool[Tensor, " n"],
    threshold: float,
) -> Bool[Tensor, " n"]:
    """The object whose core is found, with its feet, and what it encloses."""
    points = scene.means.detach().numpy()
    support = find_support(points, core.numpy(), lifted.weight.numpy())
    if support is None:
        return core
    above = torch.from_numpy(support.above(points))
    values, weight = smoothed(lifted, graph, ~above), lifted.weight
    sure = (values > threshold) & above
    looked_at = lifted.central * values
    main = connected_part((values > SUPPORTED_SHARE * threshold) & above, looked_at, graph)
    if float(weight[main].sum()) > MOST_GROWTH * float(weight[core].sum()):
        main = connected_part(sure, looked_at, graph)
    if not main.any():
        return core
    near = within(points, main.numpy(), LOOSE_DISTANCE * extent_of(points[core.numpy()]))
    others = parts(sure & ~main, graph)
    return main | _surely(others, torch.from_numpy(near), lifted, float(weight[main].sum()))


def _surely(
    number: Int[Tensor, " n"], near: Bool[Tensor, " n"], lifted: Lifted, main_weight: float
) -> Bool[Tensor, " n"]:
    """Those parts beside the main one that are surely of the subject: a hand that hovers.

    `number` is that of the part each Gaussian is in, or -1.
    """
    count = int(number.max()) + 1
    weight, probable, touching = (
        torch.zeros(count + 1).index_add_(0, number + 1, each.float())[1:]
        for each in (lifted.weight, lifted.weight * lifted.mean, near)
    )
    kept = (probable > LOOSE_MEAN * weight) & (weight > LOOSE_WEIGHT * main_weight) & (touching > 0)
    return torch.cat((kept.new_zeros(1), kept))[number + 1]


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


def smoothed(
    lifted: Lifted, graph: Neighbors, outside: Bool[Tensor, " n"] | None = None
) -> Float[Tensor, " n"]:
    """Values of which those are sure that many pixels have a part in, and that are 0 `outside`."""
    seen = lifted.weight > MIN_SEEN_PIXELS
    typical = lifted.weight[seen].median() if seen.any() else torch.tensor(1.0)
    confidence, mean = lifted.weight / (lifted.weight + typical), lifted.mean
    if outside is not None:
        confidence, mean = confidence.masked_fill(outside, 1.0), mean.masked_fill(outside, 0.0)
    return smooth(mean, confidence, graph, SMOOTHING_WEIGHT).clamp(0, 1)


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
