"""Fewer bands of spherical harmonics: a smaller file, with less view-dependent colour."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.errors import UsageError
from gsedit.files.streams import SceneHeader
from gsedit.files.table import SplatTable
from gsedit.points.operation import Rowwise, Scene, apply


@dataclass(frozen=True)
class ReduceSH(Rowwise):
    """Drop the bands above `degree`; a scene of that degree or less stays as it is."""

    degree: int

    def __post_init__(self) -> None:
        if not 0 <= self.degree <= 4:
            raise UsageError(f"SH degree {self.degree}: 0 to 4 are possible")

    def header(self, header: SceneHeader) -> SceneHeader:
        return header.replace(degree=min(header.degree, self.degree))

    def apply(self, table: SplatTable) -> SplatTable:
        return table.replace(sh=table.sh[:, : (self.degree + 1) ** 2])


def reduce_sh(scene: Scene, degree: int) -> Scene:
    """The scene with SH of at most `degree`, 0 to 4."""
    return apply(scene, ReduceSH(degree))
