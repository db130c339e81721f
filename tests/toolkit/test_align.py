"""Scenes that were moved by a known similarity are brought back."""

from __future__ import annotations

import numpy as np
import pytest

from gsedit.errors import GseditError, UsageError
from gsedit.scene.quaternions import rotation_of
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import SplatTable
from gsedit.toolkit import AlignLength, AlignToGround, apply
from gsedit.toolkit.align import register

MOVE = Similarity(rotation_of(np.array([0.4, -0.3, 0.8, 0.2])), 2.3, np.array([4.0, -7.0, 1.0]))


def splats(means: np.ndarray, colors: np.ndarray) -> SplatTable:
    n = len(means)
    quats = np.tile([1.0, 0, 0, 0], (n, 1))
    fields = [means, quats, np.full((n, 3), -4.0), np.full(n, 3.0), (colors[:, None] - 0.5) / 0.282]
    return SplatTable(*[field.astype(np.float32) for field in fields])  # pyright: ignore[reportArgumentType]


def figure(n: int, seed: int) -> SplatTable:
    """Splats on three bent tubes of different colors: no symmetry."""
    draw = np.random.default_rng(seed)
    t, kind = draw.uniform(0, 1, n), draw.integers(0, 3, n)
    curves = [
        np.stack((t, np.sin(3 * t), 0 * t), 1),
        np.stack((0.5 - t, 0.3 * t, t * t), 1),
        np.stack((0.2 * t, -0.8 * t, 0.5 * np.cos(4 * t)), 1),
    ]
    means = np.choose(kind[:, None], curves) + 0.04 * draw.normal(size=(n, 3))
    colors = np.stack((t, kind / 2, 1 - t), 1)
    return splats(means, colors)


def floor(n: int = 4000) -> SplatTable:
    """A floor at y = 1.5 (y points down) and boxes on it."""
    draw = np.random.default_rng(0)
    ground = draw.uniform(-3, 3, (n, 3)) * (1, 0.002, 1) + (0, 1.5, 0)
    things = draw.uniform(-1, 1, (n // 2, 3)) * (1, 0.7, 1) + (0, 0.8, 0)
    means = np.concatenate([ground, things])
    return splats(means, np.full_like(means, 0.5))


@pytest.mark.parametrize("up", ["-y", "z"])
def test_the_ground_is_found_and_made_level(up):
    tilted = Similarity(rotation_of(np.array([1.0, 0.1, 0.05, -0.1])), 1.0, np.array([1.0, 2, 3]))
    level = apply(tilted.table(floor()), AlignToGround(up))
    height = level.means[:4000] @ ([0, -1, 0] if up == "-y" else [0, 0, 1])
    assert np.abs(height).max() < 0.02
    things = level.means[4000:] @ ([0, -1, 0] if up == "-y" else [0, 0, 1])
    assert np.median(things) > 0.5


def test_a_part_is_laid_on_another_sampling_of_the_whole():
    part = figure(1200, 1)
    part = part[part.means[:, 0] > np.quantile(part.means[:, 0], 0.3)]
    match = register(MOVE.table(part), figure(1600, 2))
    laid = match.similarity.after(MOVE).points(part.means)
    assert np.linalg.norm(laid - part.means, axis=1).mean() < 0.03
    assert match.overlap > 0.8
    assert match.residual < 0.1


def test_a_copy_is_laid_on_its_original(monkeypatch):
    match = register(MOVE.table(figure(800, 1)), figure(800, 1))
    assert np.abs(match.similarity.after(MOVE).matrix - np.eye(4)).max() < 1e-3
    monkeypatch.setitem(__import__("sys").modules, "open3d", None)
    with pytest.raises(GseditError, match=r"pip install 'gsedit\[mesh\]'"):
        register(figure(800, 1), figure(800, 1))


def test_a_known_length():
    table = figure(100, 0)
    longer = apply(table, AlignLength((0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 1.2))
    np.testing.assert_allclose(longer.means, 0.6 * table.means, rtol=1e-6)
    with pytest.raises(UsageError, match="are the same"):
        apply(table, AlignLength((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 2.0))
