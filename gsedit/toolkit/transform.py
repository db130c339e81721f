"""Move, turn, scale and mirror splats, or some of them; SH and covariances follow exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float64

from gsedit.errors import UsageError
from gsedit.formats.streams import SceneHeader
from gsedit.formats.usd.units import rescaled
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import SPLAT_FIELDS, SplatTable, concatenate_tables
from gsedit.select.rules import EVERYTHING, Selection
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.operation import OnSelection, Say, Scene, apply
from gsedit.toolkit.steps import compose, translate


@dataclass(frozen=True, eq=False)
class Transform(OnSelection):
    """Move the selected Gaussians, or with `copy` add moved copies of them.

    Copies stand behind the rows that they were read with: of a file, behind each block.
    """

    similarity: Similarity
    copy: bool = False
    cameras: bool = False
    """Whether the cameras beside the scene's file are to move along."""
    center: Literal["origin", "pivot"] | None = None
    """The median of the selected centers comes to the origin first, or takes its place."""
    found: list[Similarity] = field(default_factory=list, repr=False, kw_only=True)

    @property
    def whole(self) -> bool:
        return self.center is not None or super().whole

    @property
    def moves(self) -> bool:
        return self.selection is EVERYTHING and not self.copy

    @property
    def moved(self) -> Similarity:
        """The similarity that is applied to the scene; about a center, known after the work."""
        return self.found[-1] if self.found else self.similarity

    def header(self, header: SceneHeader) -> SceneHeader:
        return rescaled(header, self.similarity.scale) if self.moves else header

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        inside = self.selection.mask(table)
        if self.center is not None:
            center = center_of(table.means[inside])
            say(f"center at {', '.join(f'{c:.6g}' for c in center)}")
            if self.center == "pivot":
                self.found.append(self.similarity.about(center))
            else:
                self.found.append(self.similarity.after(translate((-center).tolist())))
        return self.change(table, inside)

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        return moved_rows(table, self.moved, inside, copy=self.copy)


def center_of(means: np.ndarray) -> Float64[np.ndarray, "3"]:
    """The median of every coordinate of the finite points; the origin where there are none."""
    finite = means[np.isfinite(means).all(1)]
    return np.median(finite, 0).astype(np.float64) if len(finite) else np.zeros(3)


def moved_rows(
    table: SplatTable, similarity: Similarity, inside: Bool[np.ndarray, " n"], *, copy: bool
) -> SplatTable:
    """The table with the rows inside moved, or with moved copies of them at its end."""
    if inside.all():
        moved = similarity.table(table)
        return concatenate_tables([table, moved]) if copy else moved
    rows = np.flatnonzero(inside)
    moved = similarity.table(table[rows])
    if copy:
        return concatenate_tables([table, moved])
    return with_rows(table, rows, moved)


def with_rows(table: SplatTable, rows: np.ndarray, other: SplatTable) -> SplatTable:
    """The table with other values in some rows."""

    def put(column: np.ndarray, values: np.ndarray) -> np.ndarray:
        column = column.copy()
        column[rows] = values
        return column

    fields = {name: put(getattr(table, name), getattr(other, name)) for name in SPLAT_FIELDS}
    extra = {name: put(column, other.extra[name]) for name, column in table.extra.items()}
    return SplatTable(**fields, extra=extra)


def transform_of(
    similarity: Similarity,
    *,
    pivot: Sequence[float | int] | str | None = None,
    center: bool = False,
    selection: Selection = EVERYTHING,
    copy: bool = False,
    cameras: bool = False,
) -> Transform:
    """The operation; `pivot` is a point or "center". Raises UsageError for what contradicts."""
    if center and pivot is not None:
        raise UsageError("center moves the scene to the origin, which is the pivot then: give one")
    if cameras and (selection is not EVERYTHING or copy):
        raise UsageError("cameras move with the whole scene only, not with a part or a copy")
    if isinstance(pivot, str) and pivot != "center":
        raise UsageError(f"pivot {pivot}: give x,y,z or center")
    about = "origin" if center else "pivot" if isinstance(pivot, str) else None
    if pivot is not None and about is None:
        similarity = similarity.about(translate(pivot).translation)
    return Transform(similarity, copy, cameras, about, selection=selection)


def transform(
    scene: Scene,
    similarity: Similarity = IDENTITY,
    *,
    pivot: Sequence[float | int] | str | None = None,
    center: bool = False,
    selection: Selection | str = EVERYTHING,
    copy: bool = False,
    **steps: Any,
) -> Scene:
    """The scene after a similarity and then the `steps`, in the order in which they are written.

    Steps are the functions of gsedit.toolkit.steps, as in `transform(scene, rotate=(0, 90, 0),
    scale=2.0, translate=(1, 0, 0), mirror="x", up=("z", "-y"), quat=..., rotate_axis=...,
    matrix=...)`. `pivot` (a point, or "center") takes the place of the origin. `center` first
    moves the median of the centers to the origin. Only the selected rows move (a text is an
    expression for `where`); `copy` keeps the originals too. Raises UsageError.
    """
    whole = compose(steps.items()).after(similarity)
    chosen = as_selection(selection)
    return apply(
        scene, transform_of(whole, pivot=pivot, center=center, selection=chosen, copy=copy)
    )
