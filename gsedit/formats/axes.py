"""The axes of file formats: a scene in memory is RDF, as INRIA's .ply (x right, y down, z forward).

A name says where x, y and z point: R/L, D/U and F/B are the two ends of each of memory's axes.
"""

from __future__ import annotations

from math import isqrt

import numpy as np
from jaxtyping import Float32, Float64

from gsedit.scene.similarity import Similarity
from gsedit.scene.table import SplatTable

_ENDS = {"R": (0, 1), "L": (0, -1), "D": (1, 1), "U": (1, -1), "F": (2, 1), "B": (2, -1)}

RUB = "RUB"
"""Niantic's .spz: turned by 180 degrees about x."""
RDF = "RDF"
"""INRIA's .ply, and memory."""
LUF = "LUF"
"""glTF (+y up, the front of an asset looks along +z): turned by 180 degrees about z."""


def axes_matrix(name: str) -> Float64[np.ndarray, "3 3"]:
    """From coordinates along the axes of that name into memory's: a signed permutation."""
    matrix = np.zeros((3, 3))
    for column, letter in enumerate(name):
        axis, sign = _ENDS[letter]
        matrix[axis, column] = sign
    return matrix


def from_axes(table: SplatTable, name: str) -> SplatTable:
    """A scene that was stored along the axes of that name, in memory's."""
    return _turned(table, axes_matrix(name))


def to_axes(table: SplatTable, name: str) -> SplatTable:
    """A scene of memory's axes as it is stored along those of that name."""
    return _turned(table, axes_matrix(name).T)


def _turned(table: SplatTable, matrix: Float64[np.ndarray, "3 3"]) -> SplatTable:
    """Only signs change where no axes change places; else the general way, 40 times the work."""
    signs = np.diag(matrix)
    if (signs == 1).all():
        return table
    with np.errstate(invalid="ignore", over="ignore"):  # invalid rows stay so, and are found later
        if not signs.all():
            return Similarity(matrix, 1.0, np.zeros(3)).table(table)
        x, y, z = signs.tolist()
        return table.replace(
            means=table.means * np.array([x, y, z], np.float32),
            quats=table.quats * np.array([1, y * z, x * z, x * y], np.float32),
            sh=table.sh * sh_signs(signs, isqrt(table.sh.shape[1]) - 1)[:, None],
        )


def sh_signs(signs: Float64[np.ndarray, "3"], degree: int) -> Float32[np.ndarray, " k"]:
    """Factors of the SH coefficients where axes are flipped.

    Y_l^m is z^(l-|m|) times Re or Im of (x + iy)^|m|, times even powers: odd in z for odd l - |m|,
    in x for odd |m| (Re, m >= 0) or odd |m| + 1 (Im, m < 0), in y for Im only.
    """
    x, y, z = signs.tolist()
    orders = [(band, m) for band in range(degree + 1) for m in range(-band, band + 1)]
    rules = [x ** (abs(m) + (m < 0)) * y ** int(m < 0) * z ** (band - abs(m)) for band, m in orders]
    return np.array(rules, np.float32)
