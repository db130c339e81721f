"""Copies of a scene side by side, for `research.scale`."""

from __future__ import annotations

import pytest
import torch
from research.scale.copies import side_by_side
from research.scale.measure import ScaleMeasurement, table

from gsedit.scene.framing import bounds, guess_up
from gsedit.synthetic import demo_scene, surface_gaussians


def test_copies_stand_apart_on_one_ground_and_the_scene_comes_first():
    scene = surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))
    many = side_by_side(scene, 4)
    up, ball = guess_up(scene), bounds(scene)
    copies = many.means[len(scene) :].double().view(3, -1, 3)
    assert torch.equal(many.means[: len(scene)], scene.means)
    heights = copies @ up
    torch.testing.assert_close(heights, heights[:1].expand(3, -1), rtol=0, atol=1e-4)
    centers = torch.stack([part.median(0).values for part in (scene.means.double(), *copies)])
    assert torch.pdist(centers).min() > 3 * ball.radius
    with pytest.raises(ValueError, match="1 or more"):
        side_by_side(scene, 0)


def test_the_table_has_a_column_a_stage():
    row = ScaleMeasurement("'make it gold'", 1_900_000, 3, 91.4, {"survey": 20.4, "total": 90.0},
                           2.5, None, 41.0, 100.0)  # fmt: skip
    head, _, line = table([row]).splitlines()
    assert "survey" in head
    assert "total" not in head
    assert line == "| 'make it gold' | 1,900,000 | 3 | 91 | 20 | 2.50 | - | 41.00 | - |"
