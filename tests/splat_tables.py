"""Small tables of Gaussians for the tests of file formats, and how far two of them are apart."""

from __future__ import annotations

import numpy as np

from gsedit.scene.table import SplatTable


def random_table(n: int = 300, degree: int = 3, seed: int = 0) -> SplatTable:
    """Unit quaternions, and values inside the ranges of every packed format."""
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    quats = normal(n, 4)
    rest = (0.2 * normal(n, (degree + 1) ** 2 - 1, 3)).clip(-0.99, 0.99)
    return SplatTable(
        normal(n, 3),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
        normal(n, 3) - 4,
        2 * normal(n),
        np.concatenate((normal(n, 1, 3).clip(-3, 3), rest), 1),
    )


def near_grey(n: int, degree: int, seed: int = 0) -> SplatTable:
    """Colors in [0, 1], in one place of space: inside the ranges of every format."""
    table = random_table(n, degree, seed)
    sh = np.concatenate((table.sh[:, :1].clip(-1.7, 1.7), table.sh[:, 1:]), 1)
    return table.replace(sh=sh, means=table.means.clip(-1.5, 1.5))


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between the rotations of quaternions, radians."""
    a, b = (q.astype(np.float64) / np.linalg.norm(q, axis=1, keepdims=True) for q in (a, b))
    apart = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return 4 * np.arcsin(apart / 2)


def assert_near(
    table: SplatTable,
    to: SplatTable,
    *,
    means: float,
    angle: float,
    log_scales: float,
    opacities: float,
    colors: float,
    sh: float = 0.0,
) -> None:
    """Every value is as near as its bound says; `colors` are f_dc."""
    assert len(table) == len(to)
    assert table.sh.shape == to.sh.shape
    assert np.abs(table.means - to.means).max() <= means
    assert angles(table.quats, to.quats).max() <= angle
    assert np.abs(table.log_scales - to.log_scales).max() <= log_scales
    assert np.abs(table.opacities - to.opacities).max() <= opacities
    assert np.abs(table.sh[:, 0] - to.sh[:, 0]).max() <= colors
    assert np.abs(table.sh[:, 1:] - to.sh[:, 1:]).max(initial=0) <= sh
