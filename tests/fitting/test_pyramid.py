"""Targets are fitted at full size and halved, as long as enough pixels remain."""

from __future__ import annotations

import torch

from gsedit.fitting.update import COARSEST, pyramid
from gsedit.synthetic import demo_scene, ring_cameras
from gsedit.views.dataset import View


def view(width, height):
    camera = ring_cameras(demo_scene(), 1, 64)[0].resized(width, height)
    generator = torch.Generator().manual_seed(0)
    return View("a", camera, torch.rand(height, width, 3, generator=generator))


def test_a_small_target_stays_alone():
    targets = (view(2 * COARSEST - 1, 100),)
    assert pyramid(targets) == targets


def test_a_large_target_is_halved_while_enough_pixels_remain():
    targets = (view(900, 500), view(400, 30))
    levels = pyramid(targets)
    assert levels[:2] == targets
    sizes = [(each.camera.width, each.camera.height) for each in levels[2:]]
    assert sizes == [(450, 250), (200, 15), (225, 125)]
    for each in levels:
        assert each.image.shape == (each.camera.height, each.camera.width, 3)
    assert levels[2].camera.fx == targets[0].camera.fx / 2
    torch.testing.assert_close(levels[4].image.mean((0, 1)), targets[0].image.mean((0, 1)))
