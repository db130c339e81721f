"""A scene as numpy arrays: what files hold, and what the point-cloud tools work on without torch.

`n` Gaussians, `k` = (degree + 1)^2 SH coefficients a channel. The axes are those of INRIA's .ply
(COLMAP: x right, y down, z forward for the first camera); readers of formats with others turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from math import isqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from gsedit.scene.shapes import Float32
from rasterizer.numerics import sh_to_color

if TYPE_CHECKING:
    from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class SplatTable:
    """Gaussians as the arrays of `rasterizer.Gaussians`, with the columns a file holds beside."""

    means: Float32[np.ndarray, "n 3"]
    """Centers in world units."""
    quats: Float32[np.ndarray, "n 4"]
    """Rotations, wxyz, any non-zero norm."""
    log_scales: Float32[np.ndarray, "n 3"]
    """Natural logarithm of the standard deviations along the rotated axes, world units."""
    logit_opacities: Float32[np.ndarray, " n"]
    """Opacity is the sigmoid of this."""
    sh: Float32[np.ndarray, "n k 3"]
    """Spherical harmonics, coefficient-major: `sh[:, 0]` is the DC term."""
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Columns of the file that are no part of a Gaussian: one value a row, of any type."""

    @property
    def degree(self) -> int:
        """Degree of the spherical harmonics."""
        return isqrt(self.sh.shape[1]) - 1

    @property
    def scales(self) -> Float32[np.ndarray, "n 3"]:
        """Standard deviations along the rotated axes, world units."""
        with np.errstate(over="ignore"):
            return np.exp(self.log_scales)

    @property
    def opacities(self) -> Float32[np.ndarray, " n"]:
        """Opacities in the range [0, 1]."""
        with np.errstate(over="ignore"):
            return 1 / (1 + np.exp(-self.logit_opacities))

    @property
    def colors(self) -> Float32[np.ndarray, "n 3"]:
        """Without view dependence: 0.5 + SH_DC f_dc, display-referred, in no fixed range."""
        return sh_to_color(self.sh[:, 0])

    def __len__(self) -> int:
        return len(self.means)

    def __getitem__(self, rows: Any) -> SplatTable:
        """The rows that `rows` (slice, mask or integer array) selects, with their columns."""
        extra = {name: column[rows] for name, column in self.extra.items()}
        return SplatTable(**{name: getattr(self, name)[rows] for name in SPLAT_FIELDS}, extra=extra)

    def replace(self, **changes: Any) -> SplatTable:
        """A copy with other arrays in some fields."""
        return replace(self, **changes)


SPLAT_FIELDS = tuple(f.name for f in fields(SplatTable) if f.name != "extra")
"""The names of the arrays that are a Gaussian: those of `rasterizer.Gaussians`."""


def concatenate_tables(tables: Iterable[SplatTable]) -> SplatTable:
    """One table of all rows, in order. All have one SH degree and the same columns."""
    parts = list(tables)
    parts = [table for table in parts if len(table)] or parts[:1]
    if len(parts) == 1:
        return parts[0]
    arrays = {name: np.concatenate([getattr(t, name) for t in parts]) for name in SPLAT_FIELDS}
    extra = {name: np.concatenate([t.extra[name] for t in parts]) for name in parts[0].extra}
    return SplatTable(**arrays, extra=extra)


def uninitialised(count: int, degree: int, extra: Mapping[str, np.dtype]) -> SplatTable:
    """A table of `count` rows whose values are still to be written."""
    shapes = {"means": (3,), "quats": (4,), "log_scales": (3,), "logit_opacities": ()}
    shapes["sh"] = ((degree + 1) ** 2, 3)
    arrays = {name: np.empty((count, *shape), np.float32) for name, shape in shapes.items()}
    return SplatTable(**arrays, extra={name: np.empty(count, kind) for name, kind in extra.items()})


def gaussians_of(table: SplatTable) -> Gaussians:
    """The scene as tensors that share the memory of the arrays; extra columns are left behind."""
    import torch

    from rasterizer.scene import Gaussians

    arrays = (np.ascontiguousarray(getattr(table, name), np.float32) for name in SPLAT_FIELDS)
    return Gaussians(*(torch.from_numpy(a if a.flags.writeable else a.copy()) for a in arrays))


def table_of(scene: Gaussians) -> SplatTable:
    """The scene as arrays, float32, that share the memory of float32 tensors on the CPU."""
    return SplatTable(
        **{name: getattr(scene, name).detach().float().cpu().numpy() for name in SPLAT_FIELDS}
    )
