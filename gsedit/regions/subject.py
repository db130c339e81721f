"""The Gaussians of one object, from noisy values of single Gaussians. `n` Gaussians."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg
from torch import Tensor

from gsedit.regions.lift import Lifted
from gsedit.scene.neighbors import k_nearest
from rasterizer.numerics import sh_to_color
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


def find_subject(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """The connected object that the cameras look at, from lifted probabilities of the subject.

    None where there is no such object: no part of the scene is more probably it than not.
    """
    graph = neighbors(scene)
    values = _smoothed(lifted, graph)
    selected = values > otsu(values, lifted.weight)
    part = connected_part(selected, lifted.central * values, graph)
    weight = lifted.weight[part]
    if not part.any() or float((weight * values[part]).sum()) < 0.5 * float(weight.sum()):
        return None
    return part


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
    values = _smoothed(replace(lifted, mean=lifted.mean / scale), graph)
    inside = values > otsu(values, lifted.weight)
    means = [
        float((lifted.weight * values)[part].sum() / lifted.weight[part].sum().clamp_min(1e-9))
        for part in (inside, ~inside)
    ]
    return inside if means[1] < MAX_OUTSIDE_SHARE * means[0] else None


def find_drawn(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"]:
    """Find the Gaussians in lifted masks; those that no mask's view sees follow their neighbors."""
    return _smoothed(lifted, neighbors(scene)) > MIN_MASK_MEAN


def _smoothed(lifted: Lifted, graph: Neighbors) -> Float[Tensor, " n"]:
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


NEIGHBOR_COUNT = 8
"""Nearest neighbors of a Gaussian in the graph."""
SURFACE_COLOR_RMS = 0.1
"""Difference of two colors (RMS over channels) at which neighbors count as of two surfaces."""
MAX_DISTANCE_RATIO = 3.0
"""Neighbors farther apart than this many of their typical distances are not connected."""


@dataclass(frozen=True, eq=False)
class Neighbors:
    """The nearest neighbors of each Gaussian, and how alike they are."""

    affinity: csr_matrix
    """n x n, symmetric, in [0, 1]: 1 for two of the same color, 0 for no neighbors."""

    @cached_property
    def laplacian(self) -> csr_matrix:
        degree = np.asarray(self.affinity.sum(1)).squeeze(1)
        return diags(degree).tocsr() - self.affinity


def neighbors(scene: Gaussians) -> Neighbors:
    """The graph of a scene; its colors are those without view dependence."""
    points = scene.means.detach().double().numpy()
    n = len(points)
    k = min(NEIGHBOR_COUNT, n - 1)
    if k < 1:
        return Neighbors(csr_matrix((n, n)))
    distance, index = k_nearest(points, points, k + 1)
    distance, index = distance[:, 1:], index[:, 1:]  # the first is the point itself
    typical = np.maximum(np.median(distance, axis=1), 1e-12)
    rows, columns = np.repeat(np.arange(n), k), index.reshape(-1)
    near = distance.reshape(-1) <= MAX_DISTANCE_RATIO * np.sqrt(typical[rows] * typical[columns])
    colors = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1).numpy()
    square = np.square(colors[rows] - colors[columns]).mean(1)
    alike = np.exp(-square / (2 * SURFACE_COLOR_RMS**2)) * near
    matrix = csr_matrix((alike, (rows, columns)), shape=(n, n))
    return Neighbors(matrix.maximum(matrix.T).tocsr())


def smooth(
    values: Float[Tensor, " n"],
    confidence: Float[Tensor, " n"],
    graph: Neighbors,
    strength: float,
) -> Float[Tensor, " n"]:
    """Values that are near the given ones where these are sure, and near their neighbors'.

    They minimise sum c_i (x_i - v_i)^2 + strength / 2 sum a_ij (x_i - x_j)^2, with confidences c
    and affinities a: the random walker with priors (Grady 2005). A Gaussian without confidence
    takes the mean of its neighbors.
    """
    c = confidence.double().numpy() + 1e-6
    system = diags(c) + strength * graph.laplacian
    given = values.double().numpy()
    preconditioner = diags(1 / system.diagonal())
    solved, _ = cg(system, c * given, x0=given, rtol=1e-4, maxiter=200, M=preconditioner)
    return torch.from_numpy(solved).to(values)


def connected_part(
    selected: Bool[Tensor, " n"], score: Float[Tensor, " n"], graph: Neighbors
) -> Bool[Tensor, " n"]:
    """The connected part of the selected Gaussians with the greatest sum of scores."""
    chosen = selected.nonzero().squeeze(-1)
    if not len(chosen):
        return selected
    rows = chosen.numpy()
    count, labels = connected_components(graph.affinity[rows][:, rows], directed=False)
    totals = np.bincount(labels, weights=score[chosen].double().numpy(), minlength=count)
    part = torch.zeros_like(selected)
    part[chosen[torch.from_numpy(labels == totals.argmax())]] = True
    return part
