"""The ways to name a similarity: what `gsedit transform` and `gsedit.toolkit.transform` take."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.scene.quaternions import AXES, axis_rotation, rotation_of, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of


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
