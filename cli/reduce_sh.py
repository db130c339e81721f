"""`gsedit reduce-sh`: fewer bands of spherical harmonics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from gsedit.points.reduce_sh import ReduceSH

Degree = Annotated[int, typer.Option("--degree", min=0, max=4, help="Highest degree to keep.")]


def reduce_sh(degree: Degree = 0) -> ReduceSH:
    """Drop the bands of spherical harmonics above a degree: a smaller file, less gloss.

    gsedit reduce-sh scene.ply --degree 1 -o smaller.ply
    """
    from gsedit.points.reduce_sh import ReduceSH

    return ReduceSH(degree)
