"""Comparison of two scenes: it says nothing of equal ones, and what was done to the others."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import gsedit
from gsedit import diff
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.toolkit.differences import PROPERTIES, frame_hints, match
from gsedit.views.viewpoints import Viewpoint
from rasterizer import Gaussians


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return surface_gaussians(demo_scene(), 600, torch.Generator().manual_seed(0), sh_degree=1)


@pytest.fixture(scope="module")
def viewpoints() -> tuple[Viewpoint, ...]:
    cameras = ring_cameras(demo_scene(), 3, 32)
    return tuple(Viewpoint(f"v{i}", camera) for i, camera in enumerate(cameras))


def test_equal_scenes_do_not_differ(scene, viewpoints):
    found = gsedit.diff(scene, scene, viewpoints)
    assert found.psnr == 100
    assert found.ssim == pytest.approx(1, abs=1e-4)
    assert all(each.before == each.after for each in found.attributes)
    assert found.matches.same_rows
    assert (found.matches.moved, found.matches.color) == (0, 0)
    assert found.hints == ()


def test_other_counts_and_degrees_are_compared(scene, viewpoints):
    flat = replace(scene, sh=scene.sh[:, :1] + 0.1)[torch.arange(len(scene)) % 4 > 0]
    told = []
    found = diff(scene, flat, viewpoints, progress=lambda *step: told.append(step))
    assert found.counts == (600, 450)
    assert found.sh_degrees == (1, 0)
    assert found.matches.of_before == pytest.approx(0.75)
    assert found.matches.of_after == 1
    assert not found.matches.same_rows
    assert found.matches.color == pytest.approx(0.1 * 0.2820948, rel=1e-4)
    assert found.worst.psnr == min(view.psnr for view in found.views) < 40
    assert told == [(1, 3), (2, 3), (3, 3)]
    named = {each.name: each for each in found.attributes}
    assert tuple(named) == tuple(PROPERTIES)
    assert named["sh_energy"].after == (0, 0, 0)
    assert named["red"].after[1] == pytest.approx(named["red"].before[1] + 0.028, abs=0.02)


def test_the_order_of_rows_does_not_matter(scene):
    order = torch.randperm(len(scene), generator=torch.Generator().manual_seed(0))
    found = match(scene, scene[order])
    assert (found.of_before, found.of_after, found.same_rows) == (1, 1, False)
    assert found.moved == 0


def test_other_frames_are_noticed(scene):
    def moved(change) -> tuple[str, ...]:
        return frame_hints(scene, replace(scene, means=change(scene.means)))

    scene = replace(scene, means=scene.means + torch.tensor([0.0, 3.0, 0.5]))
    assert moved(lambda means: means + 0.01) == ()
    (flip,) = moved(lambda means: means * torch.tensor([1.0, -1.0, -1.0]))
    assert "y and z negated" in flip
    assert "mirror" not in flip
    (mirrored,) = moved(lambda means: means * torch.tensor([1.0, -1.0, 1.0]))
    assert "gsedit transform --mirror y mirrors it back" in mirrored
    (far,) = moved(lambda means: means + 100)
    assert "different places" in far
    larger, *_ = moved(lambda means: means * 3)
    assert "3 times as large" in larger
