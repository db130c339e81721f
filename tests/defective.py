"""A healthy surface, and Gaussians with one defect each that are put on or beside it."""

from __future__ import annotations

import numpy as np

from gsedit.scene.table import SplatTable, concatenate_tables

SPACING = 0.05


def plane(side: int = 40, degree: int = 1) -> SplatTable:
    """Opaque discs on a square in the plane z = 0, from -1 to 1 in x and y; random colors."""
    draw = np.random.default_rng(0)
    ticks = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = (each.ravel() for each in np.meshgrid(ticks, ticks))
    means = np.stack((x, y, 0 * x), 1) + draw.normal(0, 0.1 * SPACING, (side**2, 3))
    n = len(means)
    return SplatTable(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        log_scales=np.log(np.tile(np.array([SPACING, SPACING, SPACING / 10], np.float32), (n, 1))),
        logit_opacities=np.full(n, 3, np.float32),
        sh=draw.normal(0, 0.5, (n, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def splat(at, scales, opacity: float = 0.8, degree: int = 1) -> SplatTable:
    """One Gaussian, along the axes."""
    return SplatTable(
        means=np.array([at], np.float32),
        quats=np.array([[1, 0, 0, 0]], np.float32),
        log_scales=np.log(np.array([scales], np.float32)),
        logit_opacities=np.array([np.log(opacity / (1 - opacity))], np.float32),
        sh=np.zeros((1, (degree + 1) ** 2, 3), np.float32),
    )


def unwanted() -> tuple[SplatTable, dict[str, list[int]]]:
    """The plane with one of each defect that `clean` looks for, and the rows of each."""
    base = plane()
    n = len(base)
    parts = {
        "duplicate": base[7:8],
        "invisible": splat((0, 0, 0), (0.05, 0.05, 0.005), opacity=0.003),
        "giant": splat((0, 0, 0.1), (30, 30, 30)),
        "floater": splat((0.3, 0.2, 1.0), (0.05, 0.05, 0.05)),
        "needle": splat((0.1, 0.1, 0.3), (0.01, 0.01, 0.3)),
    }
    rows = {name: [n + i] for i, name in enumerate(parts)}
    return concatenate_tables([base, *parts.values()]), rows


def invalid() -> tuple[SplatTable, dict[str, list[int]]]:
    """The plane with defects that `load` refuses in rows 0 to 9, and the rows of each."""
    table = plane()
    means, quats, log_scales, logits, sh = (
        getattr(table, name).copy()
        for name in ("means", "quats", "log_scales", "logit_opacities", "sh")
    )
    means[0, 1] = np.nan
    quats[1] = 0  # of a disc
    quats[2], log_scales[2] = 0, -3  # of a ball
    log_scales[3, 2] = -np.inf
    log_scales[4, 0] = 50
    logits[5], logits[6], logits[7] = np.inf, -np.inf, np.nan
    sh[8, 0, 0] = np.nan
    sh[9, 2, 1] = np.inf
    rows = {
        "position": [0],
        "rotation": [1, 2],
        "scale": [3, 4],
        "opacity": [5, 6, 7],
        "color": [8],
        "harmonics": [9],
    }
    return SplatTable(means, quats, log_scales, logits, sh), rows
