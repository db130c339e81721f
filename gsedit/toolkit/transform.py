"""Move, turn, scale and mirror splats, or some of them; SH and covariances follow exactly.

Similarities are files, too: {"matrix": 4x4, "scale", "rotation_wxyz", "translation"} as JSON. Read
are also a .npy and a text of 4x4 or 3x4 numbers for column vectors.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float64

from gsedit.errors import InputError, UsageError
from gsedit.formats.flags import mapped_array
from gsedit.formats.streams import SceneHeader
from gsedit.formats.usd.file import rescaled
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file
from gsedit.run.json_files import read_json
from gsedit.scene.quaternions import AXES, axis_rotation, quaternion_of, rotation_of, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of
from gsedit.scene.table import SPLAT_FIELDS, SplatTable, concatenate_tables
from gsedit.select.selection import EVERYTHING, Selection
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.operation import OnSelection, Say, Scene, apply


def translate(offset: Sequence[float | int]) -> Similarity:
    """Move by x, y, z, world units."""
    return Similarity(np.eye(3), 1.0, _numbers("translate", offset, 3))


def rotate(degrees: Sequence[float | int]) -> Similarity:
    """Turn about the fixed axes, about x first, then y, then z: the matrix Rz Ry Rx; degrees."""
    angles = _numbers("rotate", degrees, 3)
    x, y, z = (axis_rotation(axis, angle) for axis, angle in zip(np.eye(3), angles.tolist()))
    return turned(z @ y @ x)


def rotate_axis(axis_degrees: Sequence[float | int]) -> Similarity:
    """Turn about an axis ax, ay, az, right-handed, by degrees (the fourth number)."""
    numbers = _numbers("rotate-axis", axis_degrees, 4)
    return turned(axis_rotation(_direction("rotate-axis", numbers[:3]), float(numbers[3])))


def quat(wxyz: Sequence[float | int]) -> Similarity:
    """Turn by a quaternion w, x, y, z of any norm but zero."""
    return turned(rotation_of(_direction("quat", _numbers("quat", wxyz, 4))))


def scale(factor: float) -> Similarity:
    """Scale by a positive factor."""
    if not 0 < factor < np.inf:
        raise UsageError(f"scale {factor}: give a positive number")
    return Similarity(np.eye(3), float(factor), np.zeros(3))


def mirror(axis: str) -> Similarity:
    """Change the sign of x, y or z."""
    if axis not in ("x", "y", "z"):
        raise UsageError(f"mirror {axis}: x, y and z are possible")
    return turned(np.eye(3) - 2 * np.diag(AXES[axis]))


def up(axes: Sequence[str]) -> Similarity:
    """Turn by the smallest rotation that takes the first axis to the second, as in z, -y."""
    if len(axes) != 2 or not all(axis in AXES for axis in axes):
        raise UsageError(
            f"up {','.join(axes)}: give the axis that is up and the one it becomes, each of "
            f"{', '.join(AXES)}, as in z,-y"
        )
    return turned(turn_between(*(AXES[axis] for axis in axes)))


def matrix(numbers: Any) -> Similarity:
    """A 4x4 or 3x4 matrix for column vectors."""
    try:
        return similarity_of(numbers)
    except ValueError as error:
        raise UsageError(f"matrix: {error}") from None


STEPS: dict[str, Callable[[Any], Similarity]] = {
    each.__name__: each
    for each in (translate, rotate, rotate_axis, quat, scale, mirror, up, matrix)
}


def compose(steps: Iterable[tuple[str, Any]]) -> Similarity:
    """The steps, one after the other; each is a name of STEPS with its value. Raises UsageError."""
    whole = IDENTITY
    for name, value in steps:
        if name not in STEPS:
            raise UsageError(f"{name} is no step of a transform: {', '.join(STEPS)} are")
        whole = STEPS[name](value).after(whole)
    return whole


def turned(turn: Float64[np.ndarray, "3 3"]) -> Similarity:
    """Similarity that only turns, about the origin."""
    return Similarity(turn, 1.0, np.zeros(3))


def _numbers(name: str, values: Sequence[float | int], count: int) -> Float64[np.ndarray, " count"]:
    numbers = np.array(values, np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise UsageError(f"{name} takes {count} finite numbers")
    return numbers


def _direction(name: str, numbers: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    if not numbers.any():
        raise UsageError(f"{name}: all zeros have no direction")
    return numbers


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
    if pivot is not None and not isinstance(pivot, str):
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

    Steps are the functions of gsedit.toolkit.transform, as in `transform(scene, rotate=(0, 90, 0),
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


def record_of(similarity: Similarity) -> dict[str, Any]:
    """For a JSON file; of a mirroring one the quaternion is that of -turn."""
    turn = -similarity.turn if similarity.mirrors else similarity.turn
    return {
        "matrix": similarity.matrix.tolist(),
        "scale": similarity.scale,
        "rotation_wxyz": quaternion_of(turn).tolist(),
        "mirrors": similarity.mirrors,
        "translation": similarity.translation.tolist(),
    }


def write_similarity(similarity: Similarity, path: Path, *, overwrite: bool = False) -> None:
    """Write a .json. Raises UsageError if the file exists (and not `overwrite`)."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(json.dumps(record_of(similarity), indent=1) + "\n")


def read_similarity(path: Path) -> Similarity:
    """Read a .json, a .npy or a text. Raises InputError for what is no similarity."""
    existing_file(path)
    try:
        if path.suffix == ".json":
            record = read_json(path)
            matrix = record["matrix"] if isinstance(record, dict) else record
        elif path.suffix == ".npy":
            matrix = mapped_array(path)
        else:
            matrix = np.loadtxt(path, ndmin=2)
        return similarity_of(np.array(matrix, np.float64))
    except (ValueError, KeyError, TypeError, EOFError, OverflowError) as error:
        reason = str(error) or type(error).__name__
        raise InputError(
            f"{path} holds no similarity ({reason}): give 4x4 numbers, or a file of --save"
        ) from None
