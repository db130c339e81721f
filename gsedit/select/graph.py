"""The graph of neighbors of a scene: values smoothed over it, and its connected parts.

`n` Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, radians

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int, Int64
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg
from torch import Tensor

from gsedit.scene.neighbors import k_nearest
from rasterizer.numerics import sh_to_color
from rasterizer.scene import Gaussians

NEIGHBOR_COUNT = 8
"""Nearest neighbors of a Gaussian in the graph."""
SURFACE_COLOR_RMS = 0.1
"""Difference of two colors (RMS over channels) at which neighbors count as of two surfaces."""
SURFACE_ANGLE = 45.0
"""Degrees between the normals of two neighbors at which they count as of two surfaces."""
MAX_DISTANCE_RATIO = 3.0
"""Neighbors farther apart than this many of their typical distances are not connected."""
SOLVED_TO = 1e-2
"""Relative residual of smoothed values: they are compared with thresholds, not read."""


@dataclass(frozen=True, eq=False)
class Neighbors:
    """The nearest neighbors of each Gaussian, and how alike they are."""

    affinity: csr_matrix
    """n x n, symmetric, in [0, 1]: 1 for two of the same color, 0 for no neighbors."""

    @cached_property
    def laplacian(self) -> csr_matrix:
        degree = np.asarray(self.affinity.sum(1)).squeeze(1)
        return diags(degree).tocsr() - self.affinity


Near = tuple[Float64[np.ndarray, "n k"], Int64[np.ndarray, "n k"]]
"""Distances to the nearest of each Gaussian, nearest first, and their rows."""


def nearest_of(scene: Gaussians) -> Near:
    """The NEIGHBOR_COUNT nearest of each Gaussian, or all others where there are fewer."""
    points = scene.means.detach().double().numpy()
    distance, rows = k_nearest(points, points, min(NEIGHBOR_COUNT + 1, max(len(points), 1)))
    return distance[:, 1:], rows[:, 1:]  # the first is the point itself


def neighbors(
    scene: Gaussians, normals: Float[Tensor, "n 3"] | None = None, near: Near | None = None
) -> Neighbors:
    """The graph of a scene; its colors are those without view dependence.

    With unit normals, two that face apart by SURFACE_ANGLE are as unlike as two colors of two
    surfaces. `near` are the nearest of each (`nearest_of`), where they are known.
    """
    n = len(scene)
    if n < 2:
        return Neighbors(csr_matrix((n, n)))
    distance, index = nearest_of(scene) if near is None else near
    typical = np.maximum(np.median(distance, axis=1), 1e-12)
    colors = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1).numpy()
    facing = None if normals is None else normals.detach().double().numpy()
    alike = np.empty(index.shape)
    for j, near_by in enumerate(index.T):  # all at once would be 24 numbers each in double
        unlike = np.square(colors - colors[near_by]).mean(1) / (2 * SURFACE_COLOR_RMS**2)
        if facing is not None:
            cosine = (facing * facing[near_by]).sum(1).clip(-1, 1)
            unlike += (1 - cosine) / (1 - cos(radians(SURFACE_ANGLE))) / 2
        close = distance[:, j] <= MAX_DISTANCE_RATIO * np.sqrt(typical * typical[near_by])
        alike[:, j] = np.exp(-unlike) * close
    starts = np.arange(n + 1) * index.shape[1]
    matrix = csr_matrix((alike.reshape(-1), index.reshape(-1), starts), shape=(n, n))
    return Neighbors(matrix.maximum(matrix.T).tocsr())


def smooth(
    values: Float[Tensor, " n"],
    confidence: Float[Tensor, " n"],
    graph: Neighbors,
    strength: float,
    tolerance: float = SOLVED_TO,
) -> Float[Tensor, " n"]:
    """Values that are near the given ones where these are sure, and near their neighbors'.

    They minimise sum c_i (x_i - v_i)^2 + strength / 2 sum a_ij (x_i - x_j)^2, with confidences c
    and affinities a: the random walker with priors (Grady 2005). A Gaussian without confidence
    takes the mean of its neighbors. `tolerance` is the relative residual: less is needed where few
    are sure, and most follow them from afar.
    """
    c = confidence.double().numpy() + 1e-6
    system = diags(c) + strength * graph.laplacian
    given = values.double().numpy()
    preconditioner = diags(1 / system.diagonal())
    solved, _ = cg(system, c * given, x0=given, rtol=tolerance, maxiter=200, M=preconditioner)
    return torch.from_numpy(solved).to(values)


def parts(selected: Bool[Tensor, " n"], graph: Neighbors) -> Int[Tensor, " n"]:
    """The number, from 0, of the connected part that each selected Gaussian is in; -1: none."""
    rows = selected.nonzero().squeeze(-1)
    numbers = torch.full(selected.shape, -1)
    if len(rows):
        at = rows.numpy()
        _, labels = connected_components(graph.affinity[at][:, at], directed=False)
        numbers[rows] = torch.from_numpy(labels.astype(np.int64))
    return numbers
