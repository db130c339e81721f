"""Photos of a capture as sources: focus point, up axis, depth, normals and mask."""

from __future__ import annotations

import pytest
import torch
from research.train_small.captured import UprightCylinder, captured, focus_point, mean_up
from research.train_small.sources import FAR

from gsedit.datasets.dataset import capture
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def demo():
    scene = demo_scene()
    gaussians = surface_gaussians(scene, 8000, seeded())
    cameras = ring_cameras(scene, 6, 64, elevation=25.0)
    return gaussians, cameras, capture(gaussians, cameras, [str(i) for i in range(6)])


def test_focus_point_and_up_axis_of_a_capture(demo):
    _, cameras, _ = demo
    assert focus_point(cameras).abs().max() < 1e-6
    torch.testing.assert_close(mean_up(cameras), torch.tensor([0.0, 0.0, 1.0]).double())


def test_photos_of_a_capture_get_their_geometry(demo):
    gaussians, cameras, views = demo
    subject = UprightCylinder(torch.zeros(3).double(), mean_up(cameras), 0.8, -0.3)
    sources = captured(gaussians, views, subject)
    assert sources.image.shape == (6, 64, 64, 3)
    share = float(sources.subject.mean())
    assert 0.03 < share < 0.5
    inside = sources.subject[..., 0] > 0
    assert abs(float(sources.depth[..., 0][inside].median()) - 1) < 0.05
    exact = torch.stack([demo_scene().trace(camera).normal for camera in cameras]).float()
    surface = (exact.norm(dim=-1) > 0) & (sources.depth[..., 0] < FAR)
    assert float((exact * sources.normal).sum(-1)[surface].median()) > 0.9
    sky = sources.depth[..., 0] == FAR
    assert sky.any()
    assert not sources.normal[sky].any()
