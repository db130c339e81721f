"""Views are chosen to see much, see each other, and none twice."""

from __future__ import annotations

import torch

from gsedit.synthetic import ring_cameras, scenes, surface_gaussians
from gsedit.views.orbit import orbit
from gsedit.views.plan import OVERLAP, plan_views, survey
from rasterizer.render import contributions


def arcs(views: int, gaussians: int, width: int) -> torch.Tensor:
    """View i sees a window of a circle of Gaussians."""
    weights = torch.zeros(views, gaussians)
    for i in range(views):
        start = i * gaussians // views
        weights[i, [(start + j) % gaussians for j in range(width)]] = 1.0
    return weights


def test_chosen_views_cover_the_circle_and_hold_on_to_each_other():
    weights = arcs(24, 240, 60)
    plan = plan_views(weights, 4, 5, 1.0)
    assert plan.coverage[-1] == 1.0
    assert len(set(plan.views)) == len(plan.views)
    for i, view in enumerate(plan.views[1:], start=1):
        shared = (weights[view] * weights[list(plan.views[:i])]).sum(1).max() / weights[view].sum()
        assert shared >= OVERLAP


def test_planning_stops_when_enough_is_covered():
    weights = arcs(24, 240, 120)
    plan = plan_views(weights, 2, 10, 0.9)
    assert plan.coverage[-1] >= 0.9
    assert len(plan.rounds) < 10
    assert all(c < 0.9 for c in plan.coverage[:-1])


def test_few_views_are_all_taken_once():
    plan = plan_views(arcs(3, 30, 10), 4, 2, 1.0)
    assert sorted(plan.views) == [0, 1, 2]


def test_views_that_share_nothing_are_still_planned():
    plan = plan_views(torch.eye(4), 2, 2, 1.0)
    assert sorted(plan.views) == [0, 1, 2, 3]


def test_a_survey_is_what_small_pictures_show():
    scene = scenes()[0]
    splats = surface_gaussians(scene, 500, torch.Generator().manual_seed(0))
    cameras = ring_cameras(scene, 3, 128)
    weights = survey(splats, cameras)
    assert weights.shape == (3, len(splats))
    assert torch.allclose(weights[1], contributions(splats, cameras[1].resized(64, 64)))
    tiny = orbit(splats, 2, 8)
    assert survey(splats, tiny).shape == (2, len(splats))
