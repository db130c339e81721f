"""Similarities: SH turn exactly, Gaussians move by M S M^T, and pictures do not change."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsedit.scene.quaternions import (
    axis_rotation,
    quaternion_of,
    rotate_sh,
    rotation_of,
    sh_matrix,
    turn_between,
)
from gsedit.scene.similarity import Similarity, similarity_of
from gsedit.scene.table import SplatTable
from rasterizer.harmonics import basis

DRAW = np.random.default_rng(0)
TURN = rotation_of(np.array([0.3, -0.5, 0.7, 0.2]))
MIRROR = np.diag([1.0, 1.0, -1.0]) @ TURN
DIRECTIONS = DRAW.normal(size=(200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def random_splats(n: int = 50, degree: int = 4) -> SplatTable:
    shapes = [(n, 3), (n, 4), (n, 3), (n,), (n, (degree + 1) ** 2, 3)]
    return SplatTable(*[DRAW.normal(size=shape).astype(np.float32) for shape in shapes])


def covariances(table: SplatTable) -> np.ndarray:
    axes = np.stack([rotation_of(quat) for quat in table.quats])
    axes = axes * np.exp(table.log_scales.astype(np.float64))[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("turn", [TURN, MIRROR, np.diag([-1.0, 1.0, 1.0]), -np.eye(3)])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_turned_coefficients_give_the_turned_function(turn, degree):
    matrix = sh_matrix(turn, degree)
    sh = DRAW.normal(size=(degree + 1) ** 2)
    turned = basis(torch.from_numpy(DIRECTIONS @ turn.T), degree).numpy() @ (matrix @ sh)
    assert np.abs(turned - basis(torch.from_numpy(DIRECTIONS), degree).numpy() @ sh).max() < 1e-12
    assert np.abs(matrix @ matrix.T - np.eye(len(sh))).max() < 1e-12


def test_flips_of_axes_are_exact():
    sh = DRAW.normal(size=(5, 25, 3)).astype(np.float32)
    flip = np.diag([1.0, -1.0, -1.0])
    flipped = rotate_sh(sh, flip)
    np.testing.assert_array_equal(np.abs(flipped), np.abs(sh))
    np.testing.assert_array_equal(rotate_sh(flipped, flip), sh)


@pytest.mark.parametrize("turn", [TURN, MIRROR])
def test_gaussians_keep_their_shape(turn):
    table, move = random_splats(), Similarity(turn, 1.7, np.array([1.0, -2.0, 3.0]))
    moved = move.table(table)
    linear = move.matrix[:3, :3]
    np.testing.assert_allclose(
        covariances(moved), linear @ covariances(table) @ linear.T, rtol=2e-5, atol=1e-4
    )
    np.testing.assert_allclose(
        moved.means, table.means @ linear.T + [1.0, -2.0, 3.0], rtol=1e-5, atol=1e-5
    )
    back = move.inverse.table(moved)
    np.testing.assert_allclose(back.means, table.means, atol=1e-6)
    np.testing.assert_allclose(back.sh, table.sh, atol=1e-6)
    np.testing.assert_allclose(np.abs(back.quats), np.abs(table.quats), atol=1e-6)


def test_normals_turn_with_the_scene():
    normals = DRAW.normal(size=(50, 3)).astype(np.float32)
    extra = dict(zip(("nx", "ny", "nz"), normals.T)) | {"label": np.arange(50)}
    moved = Similarity(MIRROR, 3.0, np.ones(3)).table(random_splats().replace(extra=extra))
    turned = np.stack([moved.extra[name] for name in ("nx", "ny", "nz")], 1)
    np.testing.assert_allclose(turned, normals @ MIRROR.T, atol=1e-6)
    np.testing.assert_array_equal(moved.extra["label"], np.arange(50))


def test_similarities_compose_and_invert():
    first = Similarity(TURN, 2.0, np.array([1.0, 2.0, 3.0]))
    second = Similarity(MIRROR, 0.5, np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose(second.after(first).matrix, second.matrix @ first.matrix, atol=1e-12)
    np.testing.assert_allclose(first.inverse.matrix @ first.matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(similarity_of(second.matrix).matrix, second.matrix, atol=1e-12)
    assert second.mirrors
    assert not first.mirrors
    pivot = np.array([5.0, 6.0, 7.0])
    np.testing.assert_allclose(
        first.about(pivot).points(pivot[None])[0], pivot + first.translation, atol=1e-12
    )


@pytest.mark.parametrize(
    "matrix", [np.diag([1.0, 2.0, 1.0, 1.0]), np.zeros((4, 4)), np.full((3, 4), np.nan), np.eye(3)]
)
def test_other_matrices_are_refused(matrix):
    with pytest.raises(ValueError, match=r"similarity|shears"):
        similarity_of(matrix)


def test_rotations_and_their_quaternions():
    for quat in DRAW.normal(size=(20, 4)):
        rotation = rotation_of(quat)
        np.testing.assert_allclose(rotation_of(quaternion_of(rotation)), rotation, atol=1e-12)
    for axis in np.eye(3):  # half turns: w is 0
        half = axis_rotation(axis, 180.0)
        np.testing.assert_allclose(rotation_of(quaternion_of(half)), half, atol=1e-12)
    quarter = axis_rotation(np.array([0.0, 0.0, 2.0]), 90.0)
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("end", [(0, -1, 0), (0, 1, 0), (1, 2, 3), (0, -1, 1e-9)])
def test_one_direction_is_turned_to_another(end):
    turn = turn_between(np.array([0.0, -1.0, 0.0]), np.array(end, float))
    np.testing.assert_allclose(turn @ [0, -1, 0], np.array(end) / np.linalg.norm(end), atol=1e-12)
    assert np.isclose(np.linalg.det(turn), 1)
