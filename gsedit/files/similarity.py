"""Similarities of space: turn or mirror, scale, move; of points, of Gaussians and of cameras.

numpy, float64; a scene's arrays are float32 again afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt

import numpy as np
from jaxtyping import Float32, Float64

from gsedit.files.sh_rotation import rotate_sh
from gsedit.files.table import SplatTable

NORMALS = ("nx", "ny", "nz")
"""Extra columns that turn with the scene."""
_ORTHOGONAL = 1e-4
"""Of the entries of M^T M / scale^2: files round to float32 or to a few decimals."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """x' = scale turn x + translation."""

    turn: Float64[np.ndarray, "3 3"]
    """Orthogonal: a rotation, or with determinant -1 one with a mirror."""
    scale: float
    """Positive."""
    translation: Float64[np.ndarray, "3"]

    @property
    def matrix(self) -> Float64[np.ndarray, "4 4"]:
        """For column vectors with a 1 below."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.turn
        matrix[:3, 3] = self.translation
        return matrix

    @property
    def mirrors(self) -> bool:
        """Whether left and right change places."""
        return bool(np.linalg.det(self.turn) < 0)

    @property
    def inverse(self) -> Similarity:
        back = self.turn.T
        return Similarity(back, 1 / self.scale, -(back @ self.translation) / self.scale)

    def after(self, first: Similarity) -> Similarity:
        """`first`, then this one."""
        translation = self.points(first.translation[None])[0]
        turn = nearest_orthogonal(self.turn @ first.turn)
        return Similarity(turn, self.scale * first.scale, translation)

    def about(self, pivot: Float64[np.ndarray, "3"]) -> Similarity:
        """The same with `pivot` in the place of the origin."""
        translation = self.translation + pivot - self.scale * (self.turn @ pivot)
        return Similarity(self.turn, self.scale, translation)

    def points(self, points: np.ndarray) -> Float64[np.ndarray, "n 3"]:
        """Points (n, 3) of any type, moved."""
        return points.astype(np.float64) @ (self.scale * self.turn.T) + self.translation

    def table(self, table: SplatTable) -> SplatTable:
        """The Gaussians, moved: covariance M S M^T, and SH turned exactly.

        Of a mirrored Gaussian, whose axes M R are no rotation, the axes -M R are: an ellipsoid
        is its own image under a point reflection. Columns nx, ny, nz turn too.
        """
        proper = -self.turn if self.mirrors else self.turn
        extra = dict(table.extra)
        if all(name in extra for name in NORMALS):
            normals = np.stack([extra[name] for name in NORMALS], 1) @ self.turn.T
            extra |= {n: c.astype(extra[n].dtype) for n, c in zip(NORMALS, normals.T)}
        with np.errstate(over="ignore", invalid="ignore"):
            means = self.points(table.means).astype(np.float32)
        return table.replace(
            means=means,
            quats=multiply(quaternion_of(proper), table.quats),
            log_scales=(table.log_scales + np.float64(log(self.scale))).astype(np.float32),
            sh=rotate_sh(table.sh, self.turn),
            extra=extra,
        )


IDENTITY = Similarity(np.eye(3), 1.0, np.zeros(3))


def similarity_of(matrix: np.ndarray) -> Similarity:
    """Of a 4x4 (or 3x4) matrix for column vectors.

    Raises ValueError for one that shears, scales the axes differently, or is not finite.
    """
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape not in ((3, 4), (4, 4)) or not np.isfinite(matrix).all():
        raise ValueError("a similarity is 4x4 or 3x4 finite numbers")
    if len(matrix) == 4 and not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise ValueError("the last row of a similarity is 0 0 0 1")
    linear = matrix[:3, :3]
    scale = float(np.abs(np.linalg.det(linear)) ** (1 / 3))
    if not scale or not np.allclose(linear @ linear.T / scale**2, np.eye(3), atol=_ORTHOGONAL):
        raise ValueError("the matrix shears or scales the axes differently: splats cannot follow")
    return Similarity(nearest_orthogonal(linear / scale), scale, matrix[:3, 3].copy())


def nearest_orthogonal(matrix: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "3 3"]:
    """The orthogonal matrix at the least distance from one that almost is."""
    u, _, v = np.linalg.svd(matrix)
    return u @ v


def rotation_of(quat: np.ndarray) -> Float64[np.ndarray, "3 3"]:
    """The matrix of a quaternion wxyz of any non-zero norm."""
    w, x, y, z = np.asarray(quat, np.float64) / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "4"]:
    """The unit quaternion wxyz of a rotation, w not negative.

    The eigenvector of the largest eigenvalue of Bar-Itzhack's symmetric 4x4 matrix (2000): no case
    of the rotation loses digits.
    """
    r = rotation
    symmetric = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0, 0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0, 0, 0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    quat = np.linalg.eigh(symmetric, "U")[1][:, -1]
    return quat if quat[0] >= 0 else -quat


def multiply(
    left: Float64[np.ndarray, "4"], right: Float32[np.ndarray, "n 4"]
) -> Float32[np.ndarray, "n 4"]:
    """Hamilton's product of one quaternion wxyz with many, in float64."""
    w, x, y, z = left
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return (right.astype(np.float64) @ matrix.T).astype(np.float32)


def axis_rotation(axis: np.ndarray, degrees: float) -> Float64[np.ndarray, "3 3"]:
    """Right-handed rotation about an axis of any non-zero length."""
    half = np.radians(degrees) / 2
    unit = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    return rotation_of(np.concatenate(([np.cos(half)], np.sin(half) * unit)))


def turn_between(start: np.ndarray, end: np.ndarray) -> Float64[np.ndarray, "3 3"]:
    """The smallest rotation that takes one direction to another; half a turn if opposite."""
    a = np.asarray(start, np.float64) / np.linalg.norm(start)
    b = np.asarray(end, np.float64) / np.linalg.norm(end)
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-12:
        if a @ b > 0:
            return np.eye(3)
        axis = np.cross(a, np.eye(3)[np.abs(a).argmin()])
    angle = np.degrees(np.arctan2(sqrt(max(float(axis @ axis), 0.0)), float(a @ b)))
    return axis_rotation(axis, angle if a @ b > -1 + 1e-15 else 180.0)
