"""Depth and correspondences against the exact ones of a scene."""

import itertools
from functools import cache

import pytest
import torch
from matching import correspondence, match
from small_scenes import scenes

from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from rasterizer import render

SCENES = {scene.name: scene for scene in scenes()}


@cache
def splats(name):
    """Discs on the surface of a scene."""
    return surface_gaussians(SCENES[name], 16_000, torch.Generator().manual_seed(0))


@pytest.mark.parametrize("name", SCENES)
def test_rendered_depth_is_the_exact_depth(name):
    camera = ring_cameras(SCENES[name], 1, 192)[0]
    truth = SCENES[name].trace(camera)
    found = render(splats(name), camera, median_depth=True)
    both = truth.hit & (found.alpha > 0.9)
    assert found.median_depth is not None
    error = (found.median_depth.double() - truth.depth).abs()[both] / truth.depth[both]
    assert both.sum() > 0.8 * truth.hit.sum()
    assert error.median() < 0.005


@pytest.mark.parametrize("name", SCENES)
def test_accepted_cells_correspond(name):
    """The exact point behind a cell's center falls into the cell that it was matched with."""
    scene = SCENES[name]
    cameras = ring_cameras(scene, 18, 256)[:3]  # 20 degrees apart
    seen = [render(splats(name), c, median_depth=True) for c in cameras]
    looks = [(c, s.median_depth, s.alpha) for c, s in zip(cameras, seen)]
    grid = torch.arange(32, dtype=torch.float64) * 8 + 4
    centers = torch.stack(torch.meshgrid(grid, grid, indexing="xy"), -1).view(-1, 2)
    near, total = 0, 0
    for a, b in itertools.permutations(range(3), 2):
        pairs = match(*looks[a], *looks[b])
        xy, visible = correspondence(scene, cameras[a], centers[pairs.a], cameras[b])
        assert visible.all()  # no pair across an occlusion
        near += int(((xy - centers[pairs.b]).abs().amax(-1) <= 4).sum())  # half a cell of 8 pixels
        total += len(pairs.a)
    assert total > 100
    assert near >= 0.95 * total
