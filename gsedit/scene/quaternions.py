"""Rotations as quaternions wxyz and as matrices: numpy, one or many at a time."""

from __future__ import annotations

from functools import lru_cache
from math import factorial, isqrt, pi, sqrt

import numpy as np

from gsedit.scene.shapes import Float, Float32, Float64

AXES = {
    f"{sign}{name}": float(f"{sign}1") * axis + 0.0
    for sign in ("", "-")
    for name, axis in zip("xyz", np.eye(3))
}
"""The coordinate axes and their opposites by name, as unit vectors."""


def rotations(quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotation matrices of quaternions wxyz of any norm above 0; columns are the turned axes.

    rasterizer.project.rotation_matrices is the differentiable form of this, in torch.
    """
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], 1)


def rotation_of(quat: np.ndarray) -> Float64[np.ndarray, "3 3"]:
    """The rotation matrix of one quaternion wxyz of any non-zero norm."""
    return rotations(np.asarray(quat, np.float64)[None])[0]


def quaternion_of(rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "4"]:
    """The unit quaternion wxyz of a rotation, w not negative."""
    quat = quaternions_of(rotation[None])[0]
    return quat if quat[0] >= 0 else -quat


def quaternions_of(rotations: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 4"]:
    """The unit quaternions wxyz of rotations; no case of a rotation loses digits."""
    from scipy.spatial.transform import Rotation

    if not len(rotations):
        return np.zeros((0, 4))
    return Rotation.from_matrix(rotations).as_quat()[:, [3, 0, 1, 2]]


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


def principal_axes(
    covariances: Float64[np.ndarray, "n 3 3"],
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 4"]]:
    """Variances along the principal axes, ascending, and the quaternions wxyz that turn to them."""
    variances, axes = np.linalg.eigh(covariances)
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, no mirror image
    return variances, quaternions_of(axes)


def harmonics(directions: Float64[np.ndarray, "m 3"], degree: int) -> Float64[np.ndarray, "m k"]:
    """The basis at unit directions: sqrt(2 - [m = 0]) N P_l^|m|(z) (cos or sin)(m phi)."""
    x, y, z = directions.T
    columns = np.empty((len(x), (degree + 1) ** 2))
    for m in range(degree + 1):
        turn = (x + 1j * y) ** m  # sin^m(theta) (cos m phi + i sin m phi)
        odd = np.prod(np.arange(1.0, 2 * m, 2))  # 1 * 3 * ... * (2 m - 1)
        below, here = np.zeros_like(z), np.full_like(z, (-1.0) ** m * odd)
        for band in range(m, degree + 1):
            ratio = factorial(band - m) / factorial(band + m)
            scale = sqrt((2 - (m == 0)) * (2 * band + 1) / (4 * pi) * ratio)
            columns[:, band * band + band - m] = scale * here * turn.imag
            columns[:, band * band + band + m] = scale * here * turn.real
            # associated Legendre polynomials over sin^m(theta), upwards in degree
            below, here = here, ((2 * band + 1) * z * here - (band + m) * below) / (band + 1 - m)
    return columns


def sh_matrix(turn: Float64[np.ndarray, "3 3"], degree: int) -> Float64[np.ndarray, "k k"]:
    """How coefficients change when the scene is turned by an orthogonal matrix, mirrors too.

    `sh_matrix(R) @ c` are the coefficients of the function d -> f(R^T d), where `c` are those of f.
    Orthogonal, with one block a degree; within 1e-13. Raises ValueError for another matrix.
    """
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9):
        raise ValueError("SH are turned by an orthogonal matrix only")
    directions = even_directions(64)
    before, after = harmonics(directions, degree), harmonics(directions @ turn, degree)
    matrix = np.zeros((before.shape[1],) * 2)
    for band in range(degree + 1):
        its = slice(band * band, (band + 1) ** 2)
        matrix[its, its] = np.linalg.lstsq(before[:, its], after[:, its], rcond=None)[0]
    return np.round(matrix, 14)  # a right angle has exact zeros and ones


def rotate_sh(
    sh: Float32[np.ndarray, "n k 3"], turn: Float64[np.ndarray, "3 3"]
) -> Float32[np.ndarray, "n k 3"]:
    """The coefficients of Gaussians that are turned, mirrored or both by an orthogonal matrix."""
    n, k, _ = sh.shape
    if k == 1 or not n:
        return sh
    matrix = sh_matrix(np.asarray(turn, np.float64), isqrt(k) - 1)
    # one product over (coefficient, channel) pairs: the channels lie innermost
    pairs = np.kron(matrix, np.eye(3))
    return (sh.reshape(n, 3 * k).astype(np.float64) @ pairs.T).astype(np.float32).reshape(n, k, 3)


@lru_cache(8)
def even_directions(count: int) -> Float64[np.ndarray, "m 3"]:
    """Unit vectors, even over the sphere: Fibonacci's lattice."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    angle = i * pi * (1 + sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack((ring * np.cos(angle), ring * np.sin(angle), z), 1)
