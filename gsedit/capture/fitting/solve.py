"""The colors that fit edited views best, as a linear least-squares problem.

While the geometry stays, a picture is linear in colors: for a change d of their harmonics it
changes by W d, where W holds the blending weights times the harmonics at the view's directions.
Conjugate gradients find the d that minimizes

    sum over views |W d - (target - picture)|^2 + penalty |d - d0|^2

with the column sums of the blending weights as a diagonal preconditioner. d0 is an affine map of
base colors, fitted to the change of what the views show: Gaussians of the region that no edited
view shows follow it. `n` Gaussians, of which a view may show `m`; `k` harmonics a channel, 1 or 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, repeat
from math import inf, isqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.dataset import View
from rasterizer.color_weights import ColorWeights, color_weights
from rasterizer.harmonics import basis
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.project import view_directions
from rasterizer.render import render
from rasterizer.scene import Gaussians

RIDGE = 1e-4
"""Variance of colors below which the map adds a constant: it has no slope to learn there."""
LEAST_WEIGHT = 1e-9
"""Floor of weights that are divided by."""


@dataclass(frozen=True, eq=False)
class ColorMap:
    """An affine map of colors."""

    center: Float[Tensor, "3"]
    """Mean of the colors before."""
    offset: Float[Tensor, "3"]
    """Mean of the changes."""
    slope: Float[Tensor, "3 3"]
    """Added to the change for a unit of color from the center."""
    error: float
    """Root mean square of what the map leaves of the changes that it was fitted to."""

    def change(self, colors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """The change of these colors; where they leave [0, 1] by it, only as far as its border."""
        change = self.offset + (colors - self.center) @ self.slope
        low, high = colors.clamp_max(0), colors.clamp_min(1)
        return torch.minimum(torch.maximum(colors + change, low), high) - colors


def fit_color_map(
    colors: Float[Tensor, "n 3"], change: Float[Tensor, "n 3"], weights: Float[Tensor, " n"]
) -> ColorMap:
    """The map that fits these changes of colors best, in the mean of the squares by weight.

    Without any weight it changes nothing.
    """
    share = (weights / weights.sum().clamp_min(LEAST_WEIGHT)).double()[:, None]
    center = (share * colors).sum(0)
    inputs = colors.double() - center
    offset = (share * change).sum(0)
    moments = inputs.T @ (share * inputs) + RIDGE * torch.eye(3, dtype=inputs.dtype)
    slope = torch.linalg.solve(moments, inputs.T @ (share * (change - offset)))
    left = change - offset - inputs @ slope
    error = float((share * left.square()).sum(0).mean().sqrt())
    center, offset, slope = (each.to(colors) for each in (center, offset, slope))
    return ColorMap(center, offset, slope, error)


PENALTY = 0.05
"""Pixels: what a Gaussian must show, over all views, before pictures outweigh the map."""
PENALTIES = (PENALTY, 0.5, 5.0)
"""Penalties that are tried on targets that may contradict each other."""
AS_GOOD = 1.1
"""Errors within so many times the least count as equal: of targets that contradict each other, the
ones that are left out are wrong themselves."""
LEFT_OUT = 3
"""Every so many targets are left out to try a penalty: the others predict them."""
BAND_PENALTY = 1.0
"""Pixels: the same of the change of view-dependent color, which the map leaves as it is."""
MOST_COEFFICIENTS = 4
"""Harmonics a channel that change: those of degree 0 and 1, where the scene has them."""
MOST_ITERATIONS = 12
LEAST_GAIN_DB = 0.2
"""The solve stops after an iteration that lowers the residual by less: it then fits what the
targets disagree in (docs/measurements/fitting.md)."""
SMALLEST = 1e-9
"""Pixels: floor of what is divided by."""
SHOWN_WEIGHT = 0.05
"""Pixels of weight, over all views, from which a Gaussian is shown: others follow the map."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Colors after an iteration of the solve."""

    start: Gaussians
    change: Float[Tensor, "n k 3"]
    """Change of the harmonics since the start, times SH_DC."""
    mse: float
    """Mean squared residual over the targets' pixels, of the linear model."""
    followed: int
    """Gaussians of the region that the views do not show: they follow the map of colors."""
    map_error: float
    """Root mean square of what the map leaves of the changes that the views show, in [0, 1]."""

    @property
    def scene(self) -> Gaussians:
        """A copy of the scene with these colors, made when it is asked for."""
        sh, k = self.start.sh, self.change.shape[1]
        return replace(self.start, sh=torch.cat((sh[:, :k] + self.change / SH_DC, sh[:, k:]), 1))


@dataclass(frozen=True, eq=False)
class _Shown:
    """A target and what it shows of the scene."""

    weights: ColorWeights
    harmonics: Float[Tensor, "m k"]
    """Those of the view's directions, over SH_DC."""
    mask: Float[Tensor, "h w 1"] | float
    before: Float[Tensor, "h w 3"]
    """The picture of the scene before, where the mask is."""
    missing: Float[Tensor, "h w 3"]
    """The target less that picture."""

    def picture(self, change: Float[Tensor, "n k 3"]) -> Float[Tensor, "h w 3"]:
        """The change of the picture by this change of the scene."""
        own = change.index_select(0, self.weights.rows)
        own = (self.harmonics[:, :, None] * own).sum(1)
        return self.mask * self.weights.picture_of_rows(own)


@torch.no_grad()
def solve_colors(
    scene: Gaussians,
    targets: Sequence[View],
    inside: Bool[Tensor, " n"],
    *,
    weights: Sequence[ColorWeights] | None = None,
    most_iterations: int = MOST_ITERATIONS,
    least_gain_db: float = LEAST_GAIN_DB,
    penalty: float = PENALTY,
    band_penalty: float = BAND_PENALTY,
) -> Iterator[Solution]:
    """Yield the scene after every iteration, the last one last; only colors `inside` change.

    `weights` are those of blending at the targets' cameras, where they are known, and how much
    pixels count, in [0, 1]. Colors of degree 0 and 1 move,
    those of degree 1 not for a `band_penalty` of infinity; higher bands stay. Negative colors count
    as they are, not clamped: raise them before. Pixels that a view's mask leaves out do not count.
    The residual never rises from one iteration to the next.
    """
    if not inside.any() or not targets:
        return
    k = 1 if band_penalty == inf else min(MOST_COEFFICIENTS, scene.sh.shape[1])
    views = [_shown(scene, k, *each) for each in zip(targets, weights or repeat(None))]
    base, moved = sh_to_color(scene.sh[:, 0]), inside[:, None, None].to(scene.means)
    sums = _back(len(scene), views, [v.mask + torch.zeros_like(v.missing) for v in views], 1)
    shown = sums[:, 0, :1] * moved[:, 0]
    # what surrounds a Gaussian blurs the change that it is seen to make, and its color alike
    maps = ([v.before for v in views], [v.missing for v in views])
    colors, own = (_back(len(scene), views, each, 1)[:, 0] for each in maps)
    total, shown = shown.clamp_min(SHOWN_WEIGHT), shown * (shown > SHOWN_WEIGHT)
    followed = fit_color_map(colors / total, own / total, shown[:, 0])
    count = int((inside & (shown[:, 0] == 0)).sum())
    change = torch.zeros_like(scene.sh[:, :k])
    change[:, 0] = followed.change(base) * moved[:, 0]
    prior = torch.full_like(change[0, :, :1], band_penalty).index_fill(0, torch.tensor(0), penalty)
    found = _descend(views, change, moved, sums[:, :, :1], prior, least_gain_db)
    for solved, mse in islice(found, most_iterations):
        yield Solution(scene, solved, mse, count, followed.error)


@torch.no_grad()
def trusting_penalty(
    scene: Gaussians, targets: Sequence[View], inside: Bool[Tensor, " n"]
) -> float:
    """The largest penalty by which some targets predict the others as well as by any: the more they
    contradict each other, the less a solve should follow them beyond the map of colors. PENALTY for
    fewer targets than can be parted. The arguments are those of `solve_colors`."""
    parts = [range(0, len(targets), LEFT_OUT), range(1, len(targets), LEFT_OUT)]
    if len(targets) < 2 * LEFT_OUT:
        return PENALTY
    errors = dict.fromkeys(PENALTIES, 0.0)
    for left in parts:
        kept = [i for i in range(len(targets)) if i not in left]
        for penalty in PENALTIES:
            found = solve_colors(scene, [targets[i] for i in kept], inside, penalty=penalty)
            solved = scene  # where there is nothing to solve
            for each in found:
                solved = each.scene
            drawn = [render(solved, targets[i].camera) for i in left]
            errors[penalty] += sum(
                float((each.color.clamp(0, 1) - targets[i].image).square().mean())
                for each, i in zip(drawn, left)
            )
    return max(p for p in PENALTIES if errors[p] <= AS_GOOD * min(errors.values()))


def _shown(scene: Gaussians, coefficients: int, view: View, weights: ColorWeights | None) -> _Shown:
    weights = weights or color_weights(scene, view.camera)
    mask = 1.0 if view.mask is None else view.mask[..., None].to(scene.means)
    mask = mask if weights.wanted is None else mask * weights.wanted[..., None]
    directions = view_directions(scene.means.index_select(0, weights.rows), view.camera)
    harmonics = basis(directions, isqrt(coefficients) - 1) / SH_DC
    before = mask * render(scene, view.camera).color
    return _Shown(weights, harmonics, mask, before, mask * view.image - before)


def _descend(
    views: Sequence[_Shown],
    change: Float[Tensor, "n k 3"],
    moved: Float[Tensor, "n 1 1"],
    sums: Float[Tensor, "n 1 1"],
    prior: Float[Tensor, "k 1"],
    least_gain_db: float,
) -> Iterator[tuple[Float[Tensor, "n k 3"], float]]:
    """Conjugate gradients from `change`: that of every iteration, and its mean squared residual."""
    count, k, _ = change.shape
    residuals = [view.missing - view.picture(change) for view in views]
    gradient = moved * _back(count, views, residuals, k)
    scale = moved / (sums + prior).clamp_min(SMALLEST)
    direction = scale * gradient
    steep = (gradient * direction).sum()
    pixels, before = sum(r.numel() for r in residuals), _energy(residuals)
    while steep > 0:
        seen = [view.picture(direction) for view in views]
        curved = moved * _back(count, views, seen, k) + prior * direction
        bend = (direction * curved).sum()
        if not bend > 0:  # the minimum to the last digit: its square is below float32's numbers
            break
        step = steep / bend
        change = change + step * direction
        gradient = gradient - step * curved
        residuals = [r - step * along for r, along in zip(residuals, seen)]
        after = _energy(residuals)
        if not after <= before:  # rounding: no iteration makes it better, or it is not finite
            break
        yield change, after / pixels
        if after > before * 10 ** (-least_gain_db / 10):
            break
        before, scaled = after, scale * gradient
        steep, last = (gradient * scaled).sum(), steep
        direction = scaled + steep / last * direction


def _back(
    count: int, views: Sequence[_Shown], maps: Sequence[Float[Tensor, "h w 3"]], k: int
) -> Float[Tensor, "n k 3"]:
    """The views' maps, back-projected to `k` harmonics of every Gaussian and summed."""
    total = maps[0].new_zeros(count, k, 3)
    for view, each in zip(views, maps):
        pulled = view.weights.back_to_rows(each)[:, None]
        total.index_add_(0, view.weights.rows, view.harmonics[:, :k, None] * pulled)
    return total


def _energy(residuals: Sequence[Float[Tensor, "h w 3"]]) -> float:
    return float(sum(r.double().square().sum() for r in residuals))
