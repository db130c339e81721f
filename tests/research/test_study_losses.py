"""The study of the losses runs, and its shift moves pictures as it says."""

from __future__ import annotations

import pytest
import torch
from research.loss_switch import SwitchedUpdate
from research.study_losses import Permuted, gradient_energy, moved, run

from gsedit import Dataset
from gsedit.datasets.dataset import capture
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians


@pytest.mark.parametrize(("way", "step"), enumerate([(0, 4), (4, 0), (0, -4), (-4, 0)]))
def test_a_picture_is_moved_one_way_and_its_border_repeated(way, step):
    picture = torch.rand(16, 20, 3, generator=torch.Generator().manual_seed(0))
    shifted = moved(picture, 4, way)
    inner = (slice(4, -4), slice(4, -4))
    assert torch.equal(shifted[inner], picture.roll(step, (0, 1))[inner])
    assert torch.equal(moved(picture, 0, way), picture)


def test_one_run_measures_the_result():
    scene = surface_gaussians(demo_scene(), 500, torch.Generator().manual_seed(0))
    cameras = ring_cameras(demo_scene(), 9, 32)
    data = Dataset(capture(scene, cameras, [str(i) for i in range(9)]))
    measured = run(scene, data, Permuted(), "MSE", seed=0, pixels=0, steps=10)
    assert measured["psnr"] > 15
    assert 0.5 < measured["gradient"] < 2
    flat = torch.zeros(2, 8, 8, 3)
    assert gradient_energy(flat) == 0


def test_the_switch_fits_gram_or_all_the_others():
    settings = SwitchedUpdate(loss="mse+l1+gram", switch=0.3)
    drawn = [tuple(term.name for term in settings.terms) for _ in range(300)]
    assert set(drawn) == {("gram",), ("mse", "l1")}
    assert 0.2 < drawn.count(("gram",)) / 300 < 0.4
