"""Views are chosen to see much, each other and the subject whole, and none twice."""

from __future__ import annotations

import pytest
import torch
from captures import around, facade, room, statue, statue_with_close_ups

from gsedit import EditSettings
from gsedit.paper.view_plan import (
    ViewPlan,
    led_plan,
    plan_views,
    survey,
    view_overlap,
    wholeness,
)

SETTINGS = EditSettings()


def arcs(views: int, gaussians: int, width: int) -> torch.Tensor:
    """View i sees a window of a circle of Gaussians."""
    weights = torch.zeros(views, gaussians)
    for i in range(views):
        start = i * gaussians // views
        weights[i, [(start + j) % gaussians for j in range(width)]] = 1.0
    return weights


def shared_in_batches(weights: torch.Tensor, plan: ViewPlan) -> float:
    """Mean overlap of two views of a batch."""
    shared = view_overlap(weights, weights)
    pairs = [float(shared[a, b]) for batch in plan.batches for a in batch for b in batch if a != b]
    return sum(pairs) / len(pairs)


def default_plan(weights: torch.Tensor, whole: torch.Tensor | None = None) -> ViewPlan:
    """Plan that `gsedit edit` makes for its views."""
    some = SETTINGS
    return plan_views(
        weights,
        some.views_per_batch,
        some.most_batches,
        some.coverage,
        overlap=some.overlap,
        whole=whole,
    )


def test_batches_overlap_as_asked_and_hold_on_to_each_other():
    weights = arcs(24, 240, 60)  # neighbors share five sixths, a view and the fifth after it 1/6
    plan = plan_views(weights, 4, 6, 1.0, overlap=0.5)
    shared = view_overlap(weights, weights)
    assert len(set(plan.views)) == len(plan.views)
    for number, batch in enumerate(plan.batches):
        ties = (shared[list(batch)][:, list(batch)].sum(1) - 1) / (len(batch) - 1)
        assert ties.mean() >= 0.45
        if number:
            before = [view for earlier in plan.batches[:number] for view in earlier]
            assert shared[list(batch)][:, before].max() >= 0.5
    assert plan.coverage[-1] == 1.0


@pytest.mark.parametrize("overlap", [0.0, 0.3, 0.5])
def test_more_overlap_is_bought_with_coverage_never_the_other_way_round(overlap):
    weights = arcs(36, 360, 60)
    less, more = (
        plan_views(weights, 4, 2, 1.0, overlap=share) for share in (overlap, overlap + 0.2)
    )
    assert shared_in_batches(weights, more) >= shared_in_batches(weights, less)
    assert more.coverage[-1] <= less.coverage[-1]


def test_overlap_is_a_share_and_symmetric():
    weights = torch.tensor([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 4.0, 0.0]])
    shared = view_overlap(weights, weights)
    assert torch.allclose(shared.diagonal(), torch.ones(3))
    assert torch.equal(shared, shared.T)
    assert shared[0, 1] == 0.5
    assert shared[0, 2] == 0.25  # a close-up: the same surface in four times the area


def test_views_that_show_the_subject_whole_come_first():
    scene, cameras, close_ups = statue_with_close_ups()
    weights = survey(scene, cameras)
    whole = wholeness(scene.means, cameras, weights)
    wide = [i for i in range(len(cameras)) if i not in close_ups]
    assert whole[wide].min() > whole[close_ups].max() + 0.2
    plan = default_plan(weights, whole)
    assert not set(plan.batches[0]) & set(close_ups)
    first = [bool(set(batch) & set(close_ups)) for batch in plan.batches]
    assert first == sorted(first)  # no whole batch after one with a close-up


def test_a_ring_around_an_object_is_covered_by_batches_that_overlap():
    scene, subject = statue()
    cameras = around(30, 1.6)
    weights = survey(scene, cameras)
    whole = wholeness(scene.means, cameras, weights)
    assert whole.min() > 0.8  # all show it alike
    plan = default_plan(weights, whole)
    assert shared_in_batches(weights, plan) >= 0.45
    seen = weights[list(plan.views)].amax(0) >= 0.2 * weights.amax(0)
    assert (weights.sum(0) * seen)[subject].sum() >= 0.9 * weights.sum(0)[subject].sum()


def test_a_forward_facing_capture_is_covered_in_a_round():
    scene, cameras = facade()
    weights = survey(scene, cameras)
    whole = wholeness(scene.means, cameras, weights)
    assert whole.min() > 0.7
    plan = default_plan(weights, whole)
    assert shared_in_batches(weights, plan) >= 0.5
    assert plan.coverage[0] >= 0.9


def test_in_a_room_wide_views_come_before_pieces_of_wall():
    scene, cameras = room()
    weights = survey(scene, cameras)
    whole = wholeness(scene.means, cameras, weights)
    plan = default_plan(weights, whole)
    assert all(view < 24 for view in plan.batches[0])
    assert shared_in_batches(weights, plan) >= 0.4


def test_strokes_are_drawn_in_the_views_that_lead_those_of_most_first():
    weights = torch.tensor([[3.0, 0.0, 0.0, 0.0], [0.0, 2.0, 2.0, 0.0], [1.0, 1.0, 1.0, 1.0]])
    leading = torch.tensor([0, 1, 1, -1])
    plan = led_plan(weights, leading, size=1, most=6)
    assert plan.batches == ((1,), (0,))
    assert plan.coverage == pytest.approx((6 / 11, 10 / 11))
    assert led_plan(weights, leading, size=3, most=1).batches == ((1,),)
