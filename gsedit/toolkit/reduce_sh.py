"""Fewer bands of spherical harmonics: a smaller file, with less view-dependent color."""

from __future__ import annotations

from dataclasses import dataclass
from math import log10, pi, sqrt

import numpy as np

from gsedit.errors import UsageError
from gsedit.formats.streams import Blocks, SceneHeader
from gsedit.scene.table import SplatTable
from gsedit.toolkit.operation import Operation, Say, silent


@dataclass
class Lost:
    """How much colors change, summed while blocks pass."""

    squares: float = 0.0
    weight: float = 0.0

    def add(self, table: SplatTable, kept: int) -> None:
        """Count what is lost of the coefficients from `kept` on; finite rows count, by opacity.

        Harmonics are orthonormal: over all directions, the mean square of a color that they make
        is the sum of the squared coefficients / (4 pi).
        """
        dropped = np.square(table.sh[:, kept:], dtype=np.float64).sum((1, 2)) / (3 * 4 * pi)
        weight = np.where(np.isfinite(dropped), np.nan_to_num(table.opacities), 0.0)
        self.squares += float(weight @ np.nan_to_num(dropped))
        self.weight += float(weight.sum())

    @property
    def rmse(self) -> float:
        """RMSE of a color channel over all directions, Gaussians weighted by opacity."""
        return sqrt(self.squares / self.weight) if self.weight else 0.0

    def __str__(self) -> str:
        if not self.rmse:
            return "no color changes: the bands that are dropped are 0"
        return (
            f"colors change by {self.rmse:.4f} of 1 (RMS over directions and Gaussians by "
            f"opacity, {-20 * log10(self.rmse):.1f} dB)"
        )


@dataclass(frozen=True)
class ReduceSH(Operation):
    """Drop the bands above `degree`; a scene of that degree or less stays as it is."""

    degree: int

    def __post_init__(self) -> None:
        if not 0 <= self.degree <= 4:
            raise UsageError(f"SH degree {self.degree}: 0 to 4 are possible")

    def header(self, header: SceneHeader) -> SceneHeader:
        return header.replace(degree=min(header.degree, self.degree))

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        if header.degree <= self.degree:
            say(f"has SH of degree {header.degree}: there is nothing to drop")
            yield from blocks
            return
        lost = Lost()
        for block in blocks:
            lost.add(block, (self.degree + 1) ** 2)
            yield self.apply(block)
        say(str(lost))

    def apply(self, table: SplatTable, say: Say = silent) -> SplatTable:
        return table.replace(sh=table.sh[:, : (self.degree + 1) ** 2])
