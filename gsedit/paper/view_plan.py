"""Choice of the views that an edit needs: few, that see most of the scene, in batches that overlap.

`n` Gaussians, `v` views. A view's weight on a Gaussian is the sum of its blending weights in the
picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.render import contributions
from rasterizer.scene import Gaussians

SEEN = 0.05
"""A view sees a Gaussian that it shows this well, relative to the view that shows it best."""
COVERED = 0.4
"""A view covers a Gaussian that it shows this well, relative to the median of the views that see
it. Not to the best of them: a few close-ups would leave what whole views show uncovered."""
TIE_WEIGHT = 4.0
"""Cost of an overlap that falls short, in coverage: a view whose batch sees 0.1 too little of what
it shows must add 0.4 / (views of a batch) of coverage."""
GOALS = (1.0, 0.8, 0.6)
"""Shares of the overlap asked for that are tried in turn, until no more than `MOST_LEFT` of what
was to be covered is left: where views share little, as of a fit of a million Gaussians, all of it
keeps the views on one side of the subject (docs/measurements/views.md)."""
MOST_LEFT = 0.1
"""Share of what all views see that may stay unseen for the sake of overlap."""
WHOLE_WEIGHT = 0.5
"""Cost of views that cut the subject off, in coverage: a batch that shows half of it, 0.25."""
MAX_PLANNED_GAUSSIANS = 10_000
"""Plans use an evenly strided sample of at most this many Gaussians; more change no plan."""
SEEDS = 96
"""First views that are tried for a batch, those that add most."""


@dataclass(frozen=True)
class ViewPlan:
    """Views to edit, in batches, none twice."""

    batches: tuple[tuple[int, ...], ...]
    coverage: tuple[float, ...]
    """After each batch: share of what all views see that the edited ones show well, in [0, 1]."""

    @property
    def views(self) -> tuple[int, ...]:
        return tuple(view for batch in self.batches for view in batch)


def survey(scene: Gaussians, cameras: Sequence[Camera]) -> Float[Tensor, "v n"]:
    """How much each view sees of each Gaussian, in pixels of a small picture."""
    small = [camera.fitted(64) for camera in cameras]
    return torch.stack([contributions(scene, camera) for camera in small])


def view_overlap(a: Float[Tensor, "v n"], b: Float[Tensor, "u n"]) -> Float[Tensor, "v u"]:
    """Share of what a view of `a` and one of `b` show that both show, in [0, 1], for every pair.

    A Gaussian counts by the smaller of its two weights, so that a close-up and a distant view of
    the same surface share little, as their latent cells do. On the bear its correlation with the
    share of matched cells is 0.97.
    """
    totals = torch.maximum(a.sum(1)[:, None], b.sum(1)[None])
    common = torch.stack([torch.minimum(row, b).sum(1) for row in a])
    return common / totals.clamp_min(1e-9)


def covers(weights: Float[Tensor, "v n"]) -> Bool[Tensor, "v n"]:
    """True where a view shows a Gaussian about as well as the typical view of it, or better."""
    best = weights.amax(0)
    seen = (weights > 0) & (weights >= SEEN * best)
    typical = torch.where(seen, weights, torch.nan).nanmedian(0).values.nan_to_num(0)
    return seen & (weights >= COVERED * typical)


def plan_views(
    weights: Float[Tensor, "v n"],
    views_per_batch: int,
    most: int,
    coverage: float,
    *,
    overlap: float = 0.0,
    whole: Float[Tensor, " v"] | None = None,
) -> ViewPlan:
    """Batches of views that see most of the scene, each other and the subject whole.

    Batch by batch, the one of greatest value is taken: the coverage that is reached with it, less
    `TIE_WEIGHT` times what the overlaps lack, less `WHOLE_WEIGHT` times what its views lack of the
    whole subject (`whole`, in [0, 1]; None: all show it). The overlap of a view is the mean of
    `view_overlap` with the rest of its batch; that of a batch with what was planned before is its
    best-tied pair's; both lack what they have less than `overlap`. Of each first view, a batch is
    completed greedily.

    Stops after `most` batches, when a batch reaches `coverage`, or when no view is left. Less
    overlap is asked for where much would stay unseen for it, and can be seen (`GOALS`).
    """
    planner = _Planner(weights, torch.ones(len(weights)) if whole is None else whole)
    plans: list[ViewPlan] = []
    for share in GOALS if overlap else GOALS[:1]:
        planner.goal = share * overlap
        plans.append(_planned(planner, views_per_batch, most, coverage))
        if plans[-1].coverage[-1] >= coverage - MOST_LEFT:
            return plans[-1]
    return plans[0]


def _planned(planner: _Planner, views_per_batch: int, most: int, coverage: float) -> ViewPlan:
    """The plan for the planner's goal of overlap."""
    views = len(planner.covers)
    chosen: list[int] = []
    batches: list[tuple[int, ...]] = []
    reached: list[float] = []
    while len(batches) < most and len(chosen) < views:
        batch = planner.best_batch(chosen, min(views_per_batch, views - len(chosen)))
        batches.append(batch)
        chosen += batch
        reached.append(planner.coverage(chosen))
        if reached[-1] >= coverage:
            break
    return ViewPlan(tuple(batches), tuple(reached))


def random_plan(weights: Float[Tensor, "v n"], size: int, most: int, seed: int) -> ViewPlan:
    """At most `most` batches of `size` views drawn at random, whatever they see."""
    drawn = torch.randperm(len(weights), generator=torch.Generator().manual_seed(seed))
    return _batched(weights, drawn[: most * size].tolist(), size)


def led_plan(
    weights: Float[Tensor, "v n"], leading: Int[Tensor, " n"], size: int, most: int
) -> ViewPlan:
    """The views that lead where Gaussians are, at most `most`, in batches of `size`: those that see
    most of what they lead first. Others would be drawn, and hardly weigh."""
    led = [float(row[leading == i].sum()) for i, row in enumerate(weights)]
    order = sorted((i for i, worth in enumerate(led) if worth > 0), key=lambda i: -led[i])
    return _batched(weights, order[:most], size)


def _batched(weights: Float[Tensor, "v n"], order: list[int], size: int) -> ViewPlan:
    """These views in batches of `size`, in order."""
    starts, planner = range(0, len(order), size), _Planner(weights, torch.ones(len(weights)))
    batches = tuple(tuple(order[start : start + size]) for start in starts)
    return ViewPlan(batches, tuple(planner.coverage(order[: start + size]) for start in starts))


class _Planner:
    """Record of what views cover, share and show whole; finds the next batch."""

    def __init__(self, weights: Float[Tensor, "v n"], whole: Float[Tensor, " v"]) -> None:
        weights = weights[:, :: 1 + weights.shape[1] // MAX_PLANNED_GAUSSIANS].float()
        self.covers = covers(weights).float()
        self.worth = weights.sum(0) / weights.sum().clamp_min(1e-9)
        self.shared = view_overlap(weights, weights)
        self.goal = 0.0
        self.cut_off = 1 - whole.float()

    def coverage(self, views: Sequence[int]) -> float:
        """Share of what all views see that these show well."""
        return float(self.covers[list(views)].amax(0) @ self.worth)

    def best_batch(self, chosen: list[int], size: int) -> tuple[int, ...]:
        """The next `size` views, after the chosen ones."""
        unseen = torch.ones_like(self.worth)
        if chosen:
            unseen -= self.covers[chosen].amax(0)
        alone = self.covers @ (unseen * self.worth) - self._cost_first(chosen)
        alone[chosen] = -torch.inf
        seeds = alone.argsort(descending=True, stable=True)[: min(SEEDS, len(alone) - len(chosen))]
        batches = [self._grow(int(seed), chosen, size, unseen) for seed in seeds]
        return max(batches, key=lambda found: found[0])[1]

    def _grow(
        self, seed: int, chosen: list[int], size: int, unseen: Float[Tensor, " n"]
    ) -> tuple[float, tuple[int, ...]]:
        """The value of a batch that begins with the view `seed`, and the batch."""
        batch = [seed]
        left = unseen * (1 - self.covers[seed])
        while len(batch) < size:
            added = self.covers @ (left * self.worth)
            among = self.shared[:, batch]  # v b: each candidate with the batch
            ties = torch.cat((self._ties(batch) + among, among.sum(1, keepdim=True)), 1)
            lacking = (self.goal - ties / len(batch)).clamp_min(0).mean(1)
            value = added - TIE_WEIGHT * lacking - WHOLE_WEIGHT * self.cut_off / size
            value[[*batch, *chosen]] = -torch.inf
            batch.append(int(value.argmax()))
            left = left * (1 - self.covers[batch[-1]])
        return self._value(batch, chosen, left), tuple(batch)

    def _ties(self, batch: list[int]) -> Float[Tensor, " b"]:
        """Sum of the overlaps of each view of a batch with the others."""
        among = self.shared[batch][:, batch]
        return among.sum(1) - among.diagonal()

    def _value(self, batch: list[int], chosen: list[int], left: Float[Tensor, " n"]) -> float:
        among = self._ties(batch) / max(1, len(batch) - 1)
        lacking = float((self.goal - among).clamp_min(0).mean()) if len(batch) > 1 else 0.0
        if chosen:
            lacking += max(0.0, self.goal - float(self.shared[batch][:, chosen].max()))
        cut_off = float(self.cut_off[batch].mean())
        return -float(left @ self.worth) - TIE_WEIGHT * lacking - WHOLE_WEIGHT * cut_off

    def _cost_first(self, chosen: list[int]) -> Float[Tensor, " v"]:
        """Cost of each view as the first of a batch."""
        cost = WHOLE_WEIGHT * self.cut_off
        if chosen:
            apart = self.goal - self.shared[:, chosen].amax(1)
            cost = cost + TIE_WEIGHT * apart.clamp_min(0)
        return cost


FOCUS = 4
"""Power of the share of views that have a Gaussian in their frame: at 4, what a quarter of the
views frame weighs 1/256 of what all of them do."""
COMMON = 0.5
"""Share of the views that must have some Gaussian in their frame, all of them the same, for a
capture to have a subject. Below it, as in a room seen from inside, all Gaussians count."""
MARGIN = 0.02
"""Share of the picture's sides: nearer to the border than that, a Gaussian is cut off."""
SMALL = 0.5
"""A view that shows less than this part of the typical view's area of the subject shows it badly:
from afar, or behind something."""


def wholeness(
    means: Float[Tensor, "n 3"], cameras: Sequence[Camera], weights: Float[Tensor, "v n"]
) -> Float[Tensor, " v"]:
    """How whole each view shows the subject, in [0, 1]; the best view has 1.

    The subject is what the cameras look at: a Gaussian counts by its weight in all views, times the
    share of views that have it in their frame, to the power `FOCUS`. A view shows the part of that
    which is in its frame; less of it where it shows less than `SMALL` of the typical area. It needs
    no common point of the optical axes: where all cameras see the same (a forward-facing capture)
    every view has about 1; where they look apart (a room: `COMMON`) the widest have most.
    """
    step = 1 + len(means) // MAX_PLANNED_GAUSSIANS
    means, weights = means[::step], weights[:, ::step]
    framed = torch.stack([camera.pictured(means, MARGIN)[2] for camera in cameras]).to(weights)
    share = framed.mean(0)
    most = float(share.max())
    focus = (share / most) ** FOCUS if most >= COMMON else torch.ones_like(share)
    area = weights @ focus
    inside = framed @ (weights.sum(0) * focus)
    shown = area[area > 0]
    typical = shown.median() if len(shown) else area.new_ones(())
    whole = inside * (area / (SMALL * typical)).clamp(max=1)
    return whole / whole.max().clamp_min(1e-9)
