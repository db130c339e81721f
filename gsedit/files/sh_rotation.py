"""Spherical harmonics of a scene that is turned or mirrored: exact, for any orthogonal matrix.

`k` = (degree + 1)^2 coefficients a channel, in INRIA's order and signs (Condon-Shortley phase; y,
z, x for degree 1). Each degree is a space of its own: it maps to itself by one orthogonal matrix,
which the harmonics' values in a few directions determine. float64 inside.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial, isqrt, pi, sqrt

import numpy as np
from jaxtyping import Float32, Float64

MAX_DEGREE = 4
_DIGITS = 14
"""Decimals kept of a matrix's entries: a turn by a right angle then has exact zeros and ones."""


def harmonics(directions: Float64[np.ndarray, "m 3"], degree: int) -> Float64[np.ndarray, "m k"]:
    """The basis at unit directions: sqrt(2 - [m = 0]) N P_l^|m|(z) (cos or sin)(m phi)."""
    x, y, z = directions.T
    columns = np.empty((len(x), (degree + 1) ** 2))
    for m in range(degree + 1):
        turn = (x + 1j * y) ** m  # sin^m(theta) (cos m phi + i sin m phi)
        below, here = np.zeros_like(z), np.full_like(z, (-1.0) ** m * _odd_factorial(m))
        for band in range(m, degree + 1):
            scale = sqrt((2 - (m == 0)) * (2 * band + 1) / (4 * pi) * _ratio(band, m))
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
    return np.round(matrix, _DIGITS)


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


@lru_cache(4)
def even_directions(count: int) -> Float64[np.ndarray, "m 3"]:
    """Unit vectors, even over the sphere: Fibonacci's lattice."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    angle = i * pi * (3 - sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack((ring * np.cos(angle), ring * np.sin(angle), z), 1)


def _odd_factorial(m: int) -> float:
    """1 * 3 * ... * (2 m - 1)."""
    return float(np.prod(np.arange(1, 2 * m, 2), initial=1.0))


def _ratio(band: int, m: int) -> float:
    return factorial(band - m) / factorial(band + m)
