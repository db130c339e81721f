"""Which finished views tie the next batch to those before it."""

from __future__ import annotations

import torch

from gsedit.session.edit_views import ANCHOR_OVERLAP, _anchors
from gsedit.views.dataset import View
from rasterizer.camera import Camera

NOTHING = View("view", Camera(torch.eye(4), 1.0, 1.0, 0.5, 0.5, 1, 1), torch.zeros(1, 1, 3))


def windows(*starts: int) -> torch.Tensor:
    """Views of ten Gaussians each, out of sixty."""
    weights = torch.zeros(len(starts), 60)
    for view, start in enumerate(starts):
        weights[view, start : start + 10] = 1
    return weights


def test_anchors_come_in_the_order_of_their_overlap_and_those_with_little_stay_out():
    weights = windows(0, 4, 8, 30, 6)
    found = _anchors(weights, [4], dict.fromkeys((0, 1, 2, 3), NOTHING))
    assert found == (1, 2, 0)[: len(found)]
    assert 3 not in found
    shared = [0.8, 0.8, 0.4]
    assert len(found) == sum(share >= ANCHOR_OVERLAP for share in shared)


def test_a_batch_far_from_all_has_one_anchor_and_the_first_has_none():
    weights = windows(0, 20, 45)
    assert _anchors(weights, [2], dict.fromkeys((0, 1), NOTHING)) == (0,)
    assert _anchors(weights, [2], {}) == ()


def test_a_close_up_does_not_count_more_for_its_many_pixels():
    weights = torch.stack((windows(0)[0], 9 * windows(2)[0], windows(3)[0]))
    assert _anchors(weights, [0], dict.fromkeys((1, 2), NOTHING))[0] == 2
