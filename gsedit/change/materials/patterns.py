"""Patterns in space: how much of a layer is at each point, by noise that has no seams.

Points are in radii of the subject, around its middle, with +z up; `n` points.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.change.materials.table import Layer
from gsedit.views.noise import noise

WAVES = 14
"""Plane waves of a noise on a subject: more look the same."""
OCTAVES = 4


@dataclass(frozen=True, eq=False)
class Ground:
    """Surface that patterns are on."""

    points: Float[Tensor, "n 3"]
    """Positions in radii of the subject, around its middle, +z up."""
    normals: Float[Tensor, "n 3"]
    """Outward unit normals, in the same axes."""
    hollow: Float[Tensor, " n"]
    """How much the surface is hollow or carved there, in [0, 1]."""


def share_of(layer: Layer, ground: Ground) -> Float[Tensor, " n"]:
    """How much of a layer is at each point, in [0, 1]; about its share over the surface."""
    field, width = _FIELDS[layer.pattern](ground, max(layer.scale, 1e-3))
    if not len(field):
        return field
    edge = torch.quantile(_some(field), 1 - min(max(layer.share, 0.0), 1.0))
    return torch.sigmoid((field - edge) / width)


def coverage(layers: tuple[Layer, ...], ground: Ground) -> Float[Tensor, " n"]:
    """How much any of the layers is at each point, in [0, 1]; 1 without layers."""
    bare = torch.full_like(ground.hollow, float(bool(layers)))
    for layer in layers:
        bare = bare * (1 - share_of(layer, ground))
    return 1 - bare


def grain(points: Float[Tensor, "n 3"], seed: int = 0) -> Float[Tensor, " n"]:
    """Noise of materials, with seeds apart from those of weather."""
    return noise(points, 1000 + seed, WAVES)


def turbulence(
    points: Float[Tensor, "n 3"], seed: int = 0, octaves: int = OCTAVES
) -> Float[Tensor, " n"]:
    """Noise of several sizes, each half as large and as strong as the one before."""
    return sum(
        (grain(points * 2**i, seed + i) / 2**i for i in range(octaves)),
        start=torch.zeros_like(points[:, 0]),
    )


def _warped(points: Float[Tensor, "n 3"], strength: float, seed: int = 50) -> Float[Tensor, "n 3"]:
    shifts = [turbulence(points, seed + 10 * axis, 3) for axis in range(3)]
    return points + strength * torch.stack(shifts, -1)


def _veins(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Thin lines where a bent noise is 0, thicker and fainter in turn."""
    bent = _warped(ground.points / scale, 0.45)
    lines = -grain(bent).abs() + 0.25 * grain(bent * 0.5, 7)
    return torch.maximum(lines, -1.6 * grain(bent * 1.9, 3).abs() - 0.15), 0.06


def _rings(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Year rings around an axis that leans and wanders, with fibers along it."""
    x, y, z = ground.points.unbind(-1)
    wander = 0.6 * scale * grain(ground.points * 1.2)
    away = ((x + 0.35 + 0.15 * z).square() + (y - 0.2 * z).square()).sqrt() + wander
    fiber = grain(ground.points * ground.points.new_tensor((40.0, 40.0, 3.0)), 4)
    return (2 * pi * away / scale).sin() + 0.2 * fiber, 0.22


def _grain(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Streaks along z, as in fibers and brushed metal."""
    stretched = ground.points / scale * ground.points.new_tensor((1.0, 1.0, 0.08))
    return turbulence(stretched, 2, 2), 0.5


def _specks(ground: Ground, scale: float) -> tuple[Tensor, float]:
    return grain(ground.points / scale) + 0.6 * grain(ground.points * (2.3 / scale), 5), 0.15


def _patches(ground: Ground, scale: float) -> tuple[Tensor, float]:
    return turbulence(_warped(ground.points / scale, 0.3), 11) + 0.5 * ground.hollow, 0.12


def _strata(ground: Ground, scale: float) -> tuple[Tensor, float]:
    bent = ground.points[:, 2] / scale + 0.35 * turbulence(ground.points / scale / 4, 20, 3)
    along = torch.stack((bent * 0 + 0.1, bent * 0 + 0.2, bent), -1)
    return turbulence(along, 23, 3), 0.35


def _weave(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Two threads, over and under; on each side of the subject along the axes it faces least."""
    u, v = _flat(ground)
    over = (pi * u / scale).sin() * (pi * v / scale).sin()
    return over + 0.1 * grain(ground.points / scale * 3, 6), 0.2


def _bricks(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Joints between rows of bricks, twice as long as high, each row half a brick on."""
    u, v = _flat(ground)
    row = (v / scale).floor()
    across = ((v / scale) % 1 - 0.5).abs()
    along = ((u / (2 * scale) + 0.5 * (row % 2)) % 1 - 0.5).abs()
    return torch.maximum(across, 0.5 - 2 * (0.5 - along)), 0.02


def _crevices(ground: Ground, scale: float) -> tuple[Tensor, float]:
    return ground.hollow + 0.12 * turbulence(ground.points / scale, 31), 0.1


def _up(ground: Ground, scale: float) -> tuple[Tensor, float]:
    return ground.normals[:, 2] + 0.35 * turbulence(ground.points / scale, 37), 0.12


def _flat(ground: Ground) -> tuple[Tensor, Tensor]:
    """Two coordinates along the surface: height, and the one across it that the normal faces
    least."""
    x, y, z = ground.points.unbind(-1)
    side = ground.normals.abs()
    lies = side[:, 2] > side[:, :2].amax(-1)
    u = torch.where(side[:, 0] > side[:, 1], y, x)
    return u, torch.where(lies, torch.where(side[:, 0] > side[:, 1], x, y), z)


def _some(field: Float[Tensor, " n"], at_most: int = 100_000) -> Float[Tensor, " m"]:
    """Evenly spaced values: a quantile of more is the same."""
    return field[:: 1 + len(field) // at_most]


_FIELDS = {
    "veins": _veins,
    "rings": _rings,
    "grain": _grain,
    "specks": _specks,
    "patches": _patches,
    "strata": _strata,
    "weave": _weave,
    "bricks": _bricks,
    "crevices": _crevices,
    "up": _up,
}
