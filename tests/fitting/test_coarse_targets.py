"""Large targets are fitted small first, then at full size."""

from __future__ import annotations

import torch

from gsedit import View
from gsedit.fitting import update
from gsedit.fitting.optimizer import SceneOptimizer
from gsedit.fitting.settings import UpdateSettings
from gsedit.fitting.update import COARSE_SIZE, Target, coarse, rates, update_steps
from gsedit.measures.features import FilterBank
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians


def view(width, height):
    camera = ring_cameras(demo_scene(), 1, 64)[0].resized(width, height)
    generator = torch.Generator().manual_seed(0)
    return View("a", camera, torch.rand(height, width, 3, generator=generator))


def test_a_small_target_is_its_own_copy():
    small = view(2 * COARSE_SIZE - 1, 100)
    assert coarse(small) is small


def test_a_large_target_is_halved_to_the_coarse_size():
    sizes = [(900, 500), (400, 30), (1024, 1024), (768, 1)]
    expected = [(225, 125), (200, 15), (256, 256), (192, 1)]
    for size, small in zip(sizes, expected):
        original = view(*size)
        copy = coarse(original)
        assert (copy.camera.width, copy.camera.height) == small
        assert copy.image.shape == (small[1], small[0], 3)
        assert copy.camera.fx == original.camera.fx * small[0] / size[0]
    torch.testing.assert_close(copy.image.mean((0, 1)), original.image.mean((0, 1)))


def test_the_first_steps_are_small_and_the_last_at_full_size(monkeypatch):
    drawn = []

    def record(targets, shown, side, generator):
        drawn.append(targets[0].camera.width)
        return patch(targets, shown, side, generator)

    patch = update.random_patch
    monkeypatch.setattr(update, "random_patch", record)
    scene = surface_gaussians(demo_scene(), 200, torch.Generator().manual_seed(0))
    losses = update_steps(
        SceneOptimizer(scene, rates("appearance", 1.0)),
        (Target(view(400, 300)),),
        torch.ones(len(scene), dtype=torch.bool),
        range(4),
        4,
        UpdateSettings(patches=1, patch=16),
        FilterBank(),
        torch.Generator().manual_seed(0),
    )
    assert len(list(losses)) == 4
    assert drawn == [200, 200, 200, 400]
