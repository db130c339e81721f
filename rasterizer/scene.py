"""The scene: parallel tensors, a row per Gaussian. `n` Gaussians, `k` SH coefficients a channel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import isqrt
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.notebook import scene_png


@dataclass(frozen=True, eq=False)
class Gaussians:
    """A 3D Gaussian splat scene, in the parameters that are stored and optimized."""

    means: Float[Tensor, "n 3"]
    """Positions of the centers, world units."""
    quats: Float[Tensor, "n 4"]
    """Rotations, wxyz, any non-zero norm."""
    log_scales: Float[Tensor, "n 3"]
    """Natural logarithm of the standard deviations along the rotated axes, world units."""
    logit_opacities: Float[Tensor, " n"]
    """Opacity is the sigmoid of this."""
    sh: Float[Tensor, "n k 3"]
    """Spherical harmonics, coefficient-major: `sh[:, 0]` is the DC term; k = (degree + 1)^2."""

    @property
    def scales(self) -> Float[Tensor, "n 3"]:
        """Standard deviations along the rotated axes, world units."""
        return self.log_scales.exp()

    @property
    def opacities(self) -> Float[Tensor, " n"]:
        """Opacities, each in [0, 1]."""
        return self.logit_opacities.sigmoid()

    @property
    def degree(self) -> int:
        """Degree of the spherical harmonics."""
        return isqrt(self.sh.shape[1]) - 1

    def __len__(self) -> int:
        return self.means.shape[0]

    def __repr__(self) -> str:
        kind = f"{self.means.dtype}".removeprefix("torch.")
        return f"Gaussians({len(self):,}, SH degree {self.degree}, {kind})"

    def _repr_png_(self) -> bytes | None:
        """Picture that a notebook shows."""
        return scene_png(self)

    def __getitem__(self, index: Any) -> Gaussians:
        """The rows that `index` (slice, mask or integer tensor) selects."""
        rows = isinstance(index, Tensor) and index.dtype == torch.int64 and index.ndim == 1
        if rows and (not len(index) or index.min() >= 0):
            return self.map(lambda field: field.index_select(0, index))  # 4 times faster
        return self.map(lambda field: field[index])

    def map(self, function: Callable[[Tensor], Tensor]) -> Gaussians:
        """Apply one function to every field."""
        return Gaussians(**{f.name: function(getattr(self, f.name)) for f in fields(self)})

    def to(self, dtype: torch.dtype) -> Gaussians:
        return self.map(lambda field: field.to(dtype))

    def detach(self) -> Gaussians:
        return self.map(Tensor.detach)

    def with_degree(self, degree: int) -> Gaussians:
        """Gaussians with SH of a degree: bands above it are left out, missing ones are 0."""
        sh = self.sh[:, : (degree + 1) ** 2]
        missing = sh.new_zeros(len(self), (degree + 1) ** 2 - sh.shape[1], 3)
        return replace(self, sh=torch.cat((sh, missing), 1))


def concatenate(*scenes: Gaussians) -> Gaussians:
    """One scene of all rows, in order; every scene must have the same SH degree."""
    joined = {f.name: torch.cat([getattr(s, f.name) for s in scenes]) for f in fields(Gaussians)}
    return Gaussians(**joined)
