"""The object of another scene that is to be inserted, without that scene's ground and haze.

`n` Gaussians, `g` cells a side; heights along an upward unit vector, world units.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.objects.placing.stance import spread
from gsedit.scene.framing import bounds
from gsedit.scene.quantiles import weighted_quantile
from rasterizer.scene import Gaussians

SOLID = 0.1
"""Opacity below which a Gaussian is haze, which connects nothing."""
LAYERS = 48
"""Layers of heights among which a ground is looked for, and cells along the longest side of the
grid in which parts are connected."""
APART, FEWEST = 2.5, 8
"""Least side of such a cell, in standard deviations of the Gaussians, which are 1.5 apart, and the
fewest cells along the longest side."""
BULK = (0.005, 0.995)
"""Ranks of heights between which those layers are: stray Gaussians are beyond."""
GROUND = 0.25
"""Least share of a scene's surface in a ground."""
THICK, STANDS = 0.4, 0.03
"""Largest share of all layers up to the top of a ground, and least share of the surface above it.
"""
FADED = 0.15
"""Share of the fullest layer's surface below which a layer is no longer of the ground."""
WIDER = 1.4
"""Least reach of a ground against that of what stands on it, level: a body is no wider than itself.
"""
LOOSE = 0.02
"""Least share of the main part's surface in another part that goes with it."""
BESIDE = 0.3
"""Largest distance of such a part from the main part's box, of its size."""


def main_object(scene: Gaussians, up: Float[Tensor, "3"]) -> Bool[Tensor, " n"]:
    """The object that a scene is about: what stands in its middle on its ground.

    Of a scene without a ground it is everything but stray Gaussians.
    """
    solid = scene.opacities > SOLID
    solid = solid if bool(solid.any()) else torch.ones_like(solid)
    above = above_ground(scene, up)
    raised = solid if above is None else solid & above
    numbers = _parts(scene, raised)
    main = _main_parts(scene, numbers, None if above is None else bounds(scene).center)
    return main if above is None else main & above


def above_ground(scene: Gaussians, up: Float[Tensor, "3"]) -> Bool[Tensor, " n"] | None:
    """Flag what is above the ground of a scene; None where it has no ground.

    A ground is a layer that holds much of the surface, and reaches farther than what is above it.
    """
    points, weights = scene.means.double(), spread(scene)
    heights = points @ up
    low, high = (float(weighted_quantile(heights[:, None], weights, rank)) for rank in BULK)
    step = max(high - low, 1e-12) / LAYERS
    layers = ((heights - low) / step).long().clamp(0, LAYERS - 1)
    mass = torch.zeros(LAYERS, dtype=torch.float64).index_add_(0, layers, weights)
    peak = int(mass.argmax())
    empty = (mass[peak:] < FADED * mass[peak]).nonzero()
    top = peak + int(empty[0]) if len(empty) else LAYERS
    above = heights > low + top * step
    thick = top > THICK * LAYERS or float(mass[top:].sum()) < STANDS * float(mass.sum())
    if thick or float(mass[:top].sum()) < GROUND * float(mass.sum()) or not bool(above.any()):
        return None
    level = points - heights[:, None] * up
    middle = level.median(0).values
    away = (level - middle).norm(dim=-1)[:, None]
    ground, body = (
        float(weighted_quantile(away[part], weights[part], 0.9)) for part in (~above, above)
    )
    return above if ground > WIDER * body else None


def _parts(scene: Gaussians, chosen: Bool[Tensor, " n"]) -> Int[Tensor, " n"]:
    """The number, from 1, of the connected part that each Gaussian is in; 0: none."""
    from scipy.ndimage import label

    points = scene.means[chosen].double().numpy()
    low, high = np.quantile(points, (0.001, 0.999), axis=0)
    wide = float(scene.log_scales[chosen].sort(-1).values[:, 1].median().exp())
    side = max(float((high - low).max()), 1e-9)
    cell = min(max(side / LAYERS, APART * wide), side / FEWEST)
    cells = np.floor((scene.means.double().numpy() - low) / cell).astype(np.int64) + 1
    shape = np.floor((high - low) / cell).astype(np.int64) + 3
    beyond = ((cells < 0) | (cells >= shape)).any(1)
    cells = cells.clip(0, shape - 1)
    full = np.zeros(shape, bool)
    full[tuple(cells[chosen.numpy() & ~beyond].T)] = True
    numbers = np.asarray(label(full, np.ones((3, 3, 3)))[0])  # pyright: ignore
    own = numbers[tuple(cells.T)]
    return torch.from_numpy(np.where(beyond, 0, own).astype(np.int64))


def _main_parts(
    scene: Gaussians, numbers: Int[Tensor, " n"], center: tuple[float, float, float] | None
) -> Bool[Tensor, " n"]:
    """The part with most surface, and those near it; around a center, what is far counts less."""
    weights = spread(scene)
    points = scene.means.double()
    if center is not None:
        away = (points - torch.tensor(center, dtype=torch.float64)).norm(dim=-1)
        weights = weights * torch.exp(-((away / away.median().clamp_min(1e-12)) ** 2))
    count = int(numbers.max()) + 1
    mass = torch.zeros(count, dtype=torch.float64).index_add_(0, numbers, weights)
    mass[0] = 0
    best = int(mass.argmax())
    if not best:
        return torch.ones_like(numbers, dtype=torch.bool)
    ours = points[numbers == best]
    low, high = ours.amin(0), ours.amax(0)
    margin = BESIDE * float((high - low).norm())
    near = ((points > low - margin) & (points < high + margin)).all(1)
    heavy = mass[numbers] >= LOOSE * mass[best]
    return (numbers > 0) & heavy & (near | (numbers == best))
