"""Only as many lists of views are kept as fit in memory; the steps stay the same."""

from __future__ import annotations

import torch
from tiny_edits import data, scene

from gsedit.fitting.crops import ExactCrops, ListedCrops
from gsedit.fitting.optimizer import SceneOptimizer
from gsedit.fitting.update import APPEARANCE_RATES


def test_views_beyond_the_limit_are_rendered():
    patches = [(view, (8, 8, 32, 32)) for view in data().views]
    exact, listed = ExactCrops(), ListedCrops(scene(), most_listed_pixels=3 * 48 * 48)
    for first in range(0, 8, 2):
        few = patches[first : first + 2]
        pictures = [
            crops.draw(SceneOptimizer(scene(), APPEARANCE_RATES), few).detach()
            for crops in (exact, listed)
        ]
        torch.testing.assert_close(*pictures, rtol=0, atol=2e-3)
    assert sum(kept.lists is not None for kept in listed._kept.values()) == 3


def test_pictures_that_were_met_are_met_again():
    view, box = data().views[0], (8, 8, 32, 32)
    optimizer = SceneOptimizer(scene(), APPEARANCE_RATES)
    first, second = (ListedCrops(scene(), is_coarse=True) for _ in range(2))
    first.meet(view, view.image + 0.1, optimizer)
    second.load_state(first.state())
    one, other = (crops.draw(optimizer, [(view, box)]).detach() for crops in (first, second))
    torch.testing.assert_close(one, other)
    torch.testing.assert_close(one[0], view.image[8:40, 8:40] + 0.1, rtol=0, atol=1e-4)
