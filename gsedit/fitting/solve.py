"""The colors that fit edited views best, as a linear least-squares problem.

While the geometry stays, a picture is linear in colors: for a change d of the base colors it
changes by W d, where W holds the blending weights. Conjugate gradients find the d that minimizes

    sum over views |W d - (target - picture)|^2 + penalty |d - d0|^2

with the column sums of W as a diagonal preconditioner. d0 is an affine map of colors, fitted to the
change of what the views show: Gaussians of the region that no edited view shows follow it. `n`
Gaussians.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.datasets.dataset import View
from gsedit.fitting.color_map import fit_color_map
from rasterizer.color_weights import ColorWeights, color_weights
from rasterizer.numerics import AUTO, SH_DC, Execution, sh_to_color
from rasterizer.render import render
from rasterizer.scene import Gaussians

PENALTY = 0.05
"""Pixels: what a Gaussian must show, over all views, before pictures outweigh the map."""
MOST_ITERATIONS = 12
LEAST_GAIN_DB = 0.2
"""The solve stops after an iteration that lowers the residual by less: it then fits what the
targets disagree in (bear: 7 iterations for bronze and for snow)."""
SMALLEST = 1e-9
"""Pixels: floor of what is divided by."""
SHOWN_WEIGHT = 0.05
"""Pixels of weight, over all views, from which a Gaussian is shown: others follow the map."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Colors after an iteration of the solve."""

    start: Gaussians
    change: Float[Tensor, "n 3"]
    """Change of the base colors since the start."""
    mse: float
    """Mean squared residual over the targets' pixels, of the linear model."""
    followed: int
    """Gaussians of the region that the views do not show: they follow the map of colors."""
    map_error: float
    """Root mean square of what the map leaves of the changes that the views show, in [0, 1]."""

    @property
    def scene(self) -> Gaussians:
        """A copy of the scene with these colors, made when it is asked for."""
        base = self.start.sh[:, :1] + (self.change / SH_DC)[:, None]
        return replace(self.start, sh=torch.cat((base, self.start.sh[:, 1:]), 1))


@torch.no_grad()
def solve_colors(
    scene: Gaussians,
    targets: Sequence[View],
    inside: Bool[Tensor, " n"],
    *,
    pictures: Sequence[Float[Tensor, "h w 3"]] | None = None,
    most_iterations: int = MOST_ITERATIONS,
    least_gain_db: float = LEAST_GAIN_DB,
    penalty: float = PENALTY,
    execution: Execution = AUTO,
) -> Iterator[Solution]:
    """Yield the scene after every iteration, the last one last; only colors `inside` change.

    `pictures` show the scene as it is now at the targets, for cells that stand for a larger scene;
    None: it is rendered. Base colors (degree 0) move, higher bands stay. Negative base colors count
    as they are, not clamped: raise them before. Pixels that a view's mask leaves out do not count.
    The residual never rises from one iteration to the next.
    """
    if not inside.any() or not targets:
        return
    weights = [color_weights(scene, view.camera, execution=execution) for view in targets]
    masks = [1.0 if v.mask is None else v.mask[..., None].to(scene.means) for v in targets]
    if pictures is None:
        pictures = [render(scene, view.camera, execution=execution).color for view in targets]
    before = [m * now for m, now in zip(masks, pictures)]
    residuals = [m * v.image - now for m, v, now in zip(masks, targets, before)]
    moved = inside[:, None].to(scene.means)
    sums = _back(weights, [mask + torch.zeros_like(r) for mask, r in zip(masks, residuals)])
    base, is_shown = sh_to_color(scene.sh[:, 0]), inside & (sums[:, 0] > SHOWN_WEIGHT)
    # what surrounds a Gaussian blurs the change that it is seen to make, and its color alike
    total = sums.clamp_min(SHOWN_WEIGHT)
    colors, own = (_back(weights, maps) / total for maps in (before, residuals))
    followed = fit_color_map(colors, own, sums[:, 0] * is_shown)
    change = followed.change(base) * moved
    residuals = [r - m * w.picture(change) for r, m, w in zip(residuals, masks, weights)]
    prior = penalty * moved
    found = _descend(weights, masks, residuals, change, moved, sums, prior, least_gain_db)
    for solved, mse in islice(found, most_iterations):
        yield Solution(scene, solved, mse, int((inside & ~is_shown).sum()), followed.error)


def _descend(
    weights: Sequence[ColorWeights],
    masks: Sequence[Float[Tensor, "h w 1"] | float],
    residuals: Sequence[Float[Tensor, "h w 3"]],
    change: Float[Tensor, "n 3"],
    moved: Float[Tensor, "n 1"],
    sums: Float[Tensor, "n 3"],
    prior: Float[Tensor, "n 1"],
    least_gain_db: float,
) -> Iterator[tuple[Float[Tensor, "n 3"], float]]:
    """Conjugate gradients from `change`: that of every iteration, and its mean squared residual."""
    gradient = moved * _back(weights, residuals)
    scale = moved / (sums[:, :1] + prior).clamp_min(SMALLEST)
    direction = scale * gradient
    steep = (gradient * direction).sum()
    pixels, before = sum(r.numel() for r in residuals), _energy(residuals)
    while steep > 0:
        seen = [mask * w.picture(direction) for w, mask in zip(weights, masks)]
        curved = moved * _back(weights, seen) + prior * direction
        step = steep / (direction * curved).sum()
        change = change + step * direction
        gradient = gradient - step * curved
        residuals = [r - step * along for r, along in zip(residuals, seen)]
        after = _energy(residuals)
        yield change, after / pixels
        if after > before * 10 ** (-least_gain_db / 10):
            break
        before, scaled = after, scale * gradient
        steep, last = (gradient * scaled).sum(), steep
        direction = scaled + steep / last * direction


def _back(
    weights: Sequence[ColorWeights], maps: Sequence[Float[Tensor, "h w 3"]]
) -> Float[Tensor, "n 3"]:
    """The views' maps, back-projected and summed."""
    first, *others = (w.back(each) for w, each in zip(weights, maps))
    return sum(others, first)


def _energy(residuals: Sequence[Float[Tensor, "h w 3"]]) -> float:
    return float(sum(r.double().square().sum() for r in residuals))
