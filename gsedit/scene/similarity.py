"""Similarities of space: turn or mirror, scale, move; of points, of Gaussians and of cameras.

numpy, float64; a scene's arrays are float32 again afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from gsedit.scene.quaternions import multiply, quaternion_of, rotate_sh
from gsedit.scene.table import SplatTable

if TYPE_CHECKING:
    from rasterizer.camera import Camera

NORMALS = ("nx", "ny", "nz")
"""Extra columns that turn with the scene."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """x' = scale turn x + translation."""

    turn: Float64[np.ndarray, "3 3"]
    """Orthogonal: a rotation, or with determinant -1 one with a mirror."""
    scale: float
    """Factor of lengths, more than 0."""
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
        """This similarity with `pivot` in the place of the origin."""
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
    """Similarity with this 4x4 (or 3x4) matrix for column vectors.

    Raises ValueError for one that shears, scales the axes differently, or is not finite.
    """
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape not in ((3, 4), (4, 4)) or not np.isfinite(matrix).all():
        raise ValueError("a similarity is 4x4 or 3x4 finite numbers")
    if len(matrix) == 4 and not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise ValueError("the last row of a similarity is 0 0 0 1")
    linear = matrix[:3, :3]
    scale = float(np.abs(np.linalg.det(linear)) ** (1 / 3))
    if not scale or not np.allclose(linear @ linear.T / scale**2, np.eye(3), atol=1e-4):
        raise ValueError("the matrix shears or scales the axes differently: splats cannot follow")
    return Similarity(nearest_orthogonal(linear / scale), scale, matrix[:3, 3].copy())


def nearest_orthogonal(matrix: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "3 3"]:
    """The orthogonal matrix at the least distance from one that almost is."""
    u, _, v = np.linalg.svd(matrix)
    return u @ v


def moved_camera(camera: Camera, similarity: Similarity) -> Camera:
    """The camera that sees the moved scene as `camera` sees the scene.

    No camera sees a mirrored scene the same way: this one sees the picture flipped, left for right.
    """
    rotation = camera.rotation.detach().double().numpy() @ similarity.turn.T
    center = similarity.points(camera.center.detach().double().numpy()[None])[0]
    cx = camera.cx
    if similarity.mirrors:
        rotation, cx = rotation * [[-1.0], [1.0], [1.0]], camera.width - camera.cx
    from rasterizer.camera import pose_of  # which loads torch

    return replace(camera, world_to_camera=pose_of(rotation, center), cx=cx)
