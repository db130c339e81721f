"""Gaussians as a graph of neighbours: values smoothed over it, and its connected parts.

`n` Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg
from scipy.spatial import KDTree
from torch import Tensor

from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

NEIGHBOURS = 8
COLOUR = 0.1
"""Difference of two colours (RMS over channels) at which neighbours count as of two surfaces."""
REACH = 3.0
"""Neighbours farther apart than this many of their typical distances are not connected."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The nearest neighbours of each Gaussian, and how alike they are."""

    affinity: csr_matrix
    """n x n, symmetric, in [0, 1]: 1 for two of the same colour, 0 for no neighbours."""

    @cached_property
    def laplacian(self) -> csr_matrix:
        degree = np.asarray(self.affinity.sum(1)).squeeze(1)
        return diags(degree).tocsr() - self.affinity


def neighbours(scene: Gaussians) -> Neighbours:
    """The graph of a scene; its colours are those without view dependence."""
    points = scene.means.detach().double().numpy()
    n = len(points)
    k = min(NEIGHBOURS, n - 1)
    if k < 1:
        return Neighbours(csr_matrix((n, n)))
    distance, index = (np.asarray(each) for each in KDTree(points).query(points, k=k + 1))
    distance, index = distance[:, 1:], index[:, 1:]  # the first is the point itself
    typical = np.maximum(np.median(distance, axis=1), 1e-12)
    rows, columns = np.repeat(np.arange(n), k), index.reshape(-1)
    near = distance.reshape(-1) <= REACH * np.sqrt(typical[rows] * typical[columns])
    colours = (scene.sh[:, 0].detach().double() * SH_DC + 0.5).clamp(0, 1).numpy()
    square = np.square(colours[rows] - colours[columns]).mean(1)
    alike = np.exp(-square / (2 * COLOUR**2)) * near
    matrix = csr_matrix((alike, (rows, columns)), shape=(n, n))
    return Neighbours(matrix.maximum(matrix.T).tocsr())


def smooth(
    values: Float[Tensor, " n"],
    confidence: Float[Tensor, " n"],
    graph: Neighbours,
    strength: float,
) -> Float[Tensor, " n"]:
    """Values that are near the given ones where these are sure, and near their neighbours'.

    They minimise sum c_i (x_i - v_i)^2 + strength / 2 sum a_ij (x_i - x_j)^2, with confidences c
    and affinities a: the random walker with priors (Grady 2005). A Gaussian without confidence
    takes the mean of its neighbours.
    """
    c = confidence.double().numpy() + 1e-6
    system = diags(c) + strength * graph.laplacian
    given = values.double().numpy()
    preconditioner = diags(1 / system.diagonal())
    solved, _ = cg(system, c * given, x0=given, rtol=1e-4, maxiter=200, M=preconditioner)
    return torch.from_numpy(solved).to(values)


def connected_part(
    selected: Bool[Tensor, " n"], score: Float[Tensor, " n"], graph: Neighbours
) -> Bool[Tensor, " n"]:
    """Of the selected Gaussians the connected part with the greatest sum of scores."""
    chosen = selected.nonzero().squeeze(-1)
    if not len(chosen):
        return selected
    rows = chosen.numpy()
    count, labels = connected_components(graph.affinity[rows][:, rows], directed=False)
    totals = np.bincount(labels, weights=score[chosen].double().numpy(), minlength=count)
    part = torch.zeros_like(selected)
    part[chosen[torch.from_numpy(labels == totals.argmax())]] = True
    return part
