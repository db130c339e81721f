"""The promised numbers: renderer against reference, depth and correspondences against the truth."""

from __future__ import annotations

import bench
import pytest
import torch
from garden import POINTS, garden

from gsedit.correspond import correspond
from gsedit.synthetic import ring_cameras, scenes, surface_gaussians
from rasterizer.reference import render_reference
from rasterizer.render import render

SCENES = {scene.name: scene for scene in scenes()}


@pytest.fixture(scope="module")
def splats():
    """Twelve thousand discs on the surface of every scene."""
    return {
        name: surface_gaussians(scene, 12_000, torch.Generator().manual_seed(0))
        for name, scene in SCENES.items()
    }


def check_against_reference(scene, camera):
    found, gradients = bench.gradients(render, scene, camera)
    wanted, exact = bench.gradients(render_reference, scene, camera)
    assert (found.double() - wanted).abs().mean() < 1e-5
    for name, a, b in zip(bench.FIELDS, gradients, exact):
        assert (a - b).norm() < 1e-3 * b.norm(), name


@pytest.mark.parametrize("name", SCENES)
def test_float32_pictures_and_gradients_are_the_references(name, splats):
    check_against_reference(splats[name], ring_cameras(SCENES[name], 1, 64)[0])


@pytest.mark.skipif(not POINTS.exists(), reason=f"the garden's points are not at {POINTS}")
def test_the_garden_is_the_references():
    check_against_reference(*garden(0.125))


@pytest.mark.parametrize("name", SCENES)
def test_rendered_depth_is_the_exact_depth(name, splats):
    camera = ring_cameras(SCENES[name], 1, 192)[0]
    truth = SCENES[name].trace(camera)
    found = render(splats[name], camera, median_depth=True)
    both = truth.hit & (found.alpha > 0.9)
    assert found.median_depth is not None
    error = (found.median_depth.double() - truth.depth).abs()[both] / truth.depth[both]
    assert both.sum() > 0.8 * truth.hit.sum()
    assert error.median() < 0.005


@pytest.mark.parametrize("name", SCENES)
def test_accepted_cells_correspond(name, splats):
    """The exact point behind a cell's centre falls into the cell that it was matched with."""
    scene = SCENES[name]
    cameras = ring_cameras(scene, 18, 256)[:4]  # 20 degrees apart
    seen = [render(splats[name], c, median_depth=True) for c in cameras]
    depths = torch.stack([s.median_depth for s in seen if s.median_depth is not None])
    found = correspond(cameras, depths, torch.stack([s.alpha for s in seen]))
    grid = torch.arange(32, dtype=torch.float64) * 8 + 4
    centres = torch.stack(torch.meshgrid(grid, grid, indexing="xy"), -1)
    near, hidden, total = 0, 0, 0
    for a in range(4):
        for b in range(4):
            rows, columns = _partners(found.labels, a, b)
            if a == b or not len(rows):
                continue
            xy, visible = scene.correspondence(cameras[a], centres.view(-1, 2)[rows], cameras[b])
            offset = (xy - centres.view(-1, 2)[columns]).abs().amax(-1) / 8
            near += int((offset[visible] <= 0.5).sum())
            hidden += int((~visible).sum())
            total += len(rows)
    assert total > 200
    assert hidden == 0  # no pair across an occlusion
    assert near >= 0.95 * total


def _partners(labels, a, b):
    """Flat cells of view a and of view b that are in one cluster."""
    mine, theirs = labels[a].flatten(), labels[b].flatten()
    where = {int(label): i for i, label in enumerate(theirs.tolist()) if label >= 0}
    rows = [i for i, label in enumerate(mine.tolist()) if label in where]
    return torch.tensor(rows), torch.tensor([where[int(mine[i])] for i in rows])
