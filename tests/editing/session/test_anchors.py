"""Choice of the finished views that tie the next batch to those before it."""

from __future__ import annotations

import torch

from gsedit.paper.edit_views import MIN_ANCHOR_OVERLAP, choose_anchors


def windows(*starts: int) -> torch.Tensor:
    """Views of ten Gaussians each, out of sixty."""
    weights = torch.zeros(len(starts), 60)
    for view, start in enumerate(starts):
        weights[view, start : start + 10] = 1
    return weights


def test_anchors_come_in_the_order_of_their_overlap_and_those_with_little_stay_out():
    weights = windows(0, 4, 8, 30, 6)
    found = choose_anchors(weights, [4], (0, 1, 2, 3))
    assert found == (1, 2, 0)[: len(found)]
    assert 3 not in found
    shared = [0.8, 0.8, 0.4]
    assert len(found) == sum(share >= MIN_ANCHOR_OVERLAP for share in shared)


def test_a_batch_far_from_all_has_one_anchor_and_the_first_has_none():
    weights = windows(0, 20, 45)
    assert choose_anchors(weights, [2], (0, 1)) == (0,)
    assert choose_anchors(weights, [2], ()) == ()


def test_a_close_up_does_not_count_more_for_its_many_pixels():
    weights = torch.stack((windows(0)[0], 9 * windows(2)[0], windows(3)[0]))
    assert choose_anchors(weights, [0], (1, 2))[0] == 2
