"""Which views an edit needs: few, that see most of the scene, and enough of each other.

`n` Gaussians, `v` views. A view's weight on a Gaussian is the sum of its blending weights in the
picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import contributions
from rasterizer.scene import Gaussians

SURVEY_SIZE = 64
"""Longest side, pixels, of the small renders that tell what a view sees."""
SEEN = 0.2
"""A view covers a Gaussian that it shows this well, relative to the view that shows it best."""
OVERLAP = 0.3
"""Least fraction of a new view that one chosen view sees as well: on a ring, about 60 degrees.

On the bear 0.5 ties views no better (they agree either way) and leaves more of it uncovered."""


@dataclass(frozen=True)
class ViewPlan:
    """Views to edit, a batch a round, none twice."""

    rounds: tuple[tuple[int, ...], ...]
    coverage: tuple[float, ...]
    """After each round: share of what all views see that the edited ones show well, in [0, 1]."""

    @property
    def views(self) -> tuple[int, ...]:
        return tuple(view for batch in self.rounds for view in batch)


def survey(
    scene: Gaussians, cameras: Sequence[Camera], execution: Execution = AUTO
) -> Float[Tensor, "v n"]:
    """How much each view sees of each Gaussian, in pixels of a small picture."""
    rows = []
    for camera in cameras:
        scale = min(1.0, SURVEY_SIZE / max(camera.width, camera.height))
        small = camera.resized(
            max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
        )
        rows.append(contributions(scene, small, execution=execution))
    return torch.stack(rows)


def plan_views(
    weights: Float[Tensor, "v n"], views_per_round: int, rounds: int, coverage: float
) -> ViewPlan:
    """Greedily take the view that newly covers most, among those that overlap the chosen ones.

    Stops after `rounds`, when `coverage` is reached at the end of a round, or when no view is left.
    """
    covers = weights >= SEEN * weights.amax(0).clamp_min(1e-9)
    worth = weights.sum(0)
    total = worth.sum().clamp_min(1e-9)
    chosen: list[int] = []
    batches: list[tuple[int, ...]] = []
    reached: list[float] = []
    seen = torch.zeros(weights.shape[1], dtype=torch.bool)
    for _ in range(rounds):
        batch: list[int] = []
        while len(batch) < views_per_round and len(chosen) < len(weights):
            best = _best_view(weights, covers, worth, seen, chosen)
            batch.append(best)
            chosen.append(best)
            seen |= covers[best]
        if not batch:
            break
        batches.append(tuple(batch))
        reached.append(float(worth[seen].sum() / total))
        if reached[-1] >= coverage:
            break
    return ViewPlan(tuple(batches), tuple(reached))


def _best_view(
    weights: Float[Tensor, "v n"],
    covers: Bool[Tensor, "v n"],
    worth: Float[Tensor, " n"],
    seen: Bool[Tensor, " n"],
    chosen: list[int],
) -> int:
    gain = (covers & ~seen).to(worth) @ worth
    if chosen:
        common = weights @ covers[chosen].to(worth).T
        overlap = common.amax(1) / weights.sum(1).clamp_min(1e-9)
        free = torch.ones(len(weights), dtype=torch.bool)
        free[chosen] = False
        enough = free & (overlap >= OVERLAP)
        if not enough.any():  # nothing touches what is chosen: then what comes nearest
            gain, enough = overlap, free
        gain = torch.where(enough, gain, -1.0)
    return int(gain.argmax())
