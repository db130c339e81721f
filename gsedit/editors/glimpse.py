"""Small pictures of latents without a decoder: a linear map of cells, fitted to known pictures.

`v` views of `h w` pixels, `c y x` latents.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.image_ops import downscale


@dataclass(frozen=True, eq=False)
class Glimpse:
    """A map of a latent cell to the mean color of its pixels."""

    matrix: Float[Tensor, "k 3"]
    """Weights of the channels, and last the constant."""

    @classmethod
    def fit(cls, latents: Float[Tensor, "v c y x"], images: Float[Tensor, "v h w 3"]) -> Glimpse:
        """The map that suits these pictures and their latents best, by least squares."""
        rows, columns = latents.shape[2:]
        colors = torch.stack([downscale(image, columns, rows) for image in images])
        cells = _with_ones(latents).reshape(-1, latents.shape[1] + 1)
        return cls(torch.linalg.lstsq(cells, colors.reshape(-1, 3).double()).solution)

    def picture(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v y x 3"]:
        """A pixel for each cell, in [0, 1]."""
        return (_with_ones(latents) @ self.matrix).float().clamp(0, 1)


def _with_ones(latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v y x k"]:
    cells = latents.detach().movedim(1, -1).double()
    return torch.cat((cells, torch.ones_like(cells[..., :1])), -1)
