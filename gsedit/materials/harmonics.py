"""Colors by direction as spherical harmonics, fitted to the directions that cameras see.

`n` Gaussians, `v` directions, `k` = (degree + 1)^2 coefficients a channel.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.harmonics import basis

RIDGE = (0.0, 1e-3, 2e-3, 4e-3)
"""Penalty of the squared coefficients of each degree, against the squared error of colors."""


def fitted(
    colors: Float[Tensor, "n v 3"],
    directions: Float[Tensor, "v 3"],
    weights: Float[Tensor, "n v"],
    degree: int,
) -> Float[Tensor, "n k 3"]:
    """Coefficients with the least weighted squared error to display colors less 0.5.

    `directions` are unit vectors from cameras to Gaussians. Weights need not sum to 1; a row of
    zeros has coefficients of zero.
    """
    harmonics = basis(directions, degree)
    k = harmonics.shape[1]
    share = weights / weights.sum(1, keepdim=True).clamp_min(1e-9)
    products = (harmonics[:, :, None] * harmonics[:, None]).reshape(len(directions), k * k)
    penalty = torch.tensor([RIDGE[band] for band in range(degree + 1) for _ in range(2 * band + 1)])
    matrix = (share @ products).reshape(-1, k, k) + torch.diag(penalty.to(share) + 1e-6)
    right = torch.einsum("nv,vk,nvc->nkc", share, harmonics, colors - 0.5)
    return torch.cholesky_solve(right, torch.linalg.cholesky(matrix))
