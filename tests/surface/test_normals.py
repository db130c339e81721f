"""Normals of Gaussians against those of exact surfaces."""

from dataclasses import replace

import pytest
import torch
from plain_scenes import needles
from small_scenes import scenes

from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from gsedit.bench.synthetic.shapes import gradient
from gsedit.scene.similarity import moved_camera
from gsedit.toolkit.transform import rotate_axis, transform, translate
from gsedit.views.normals import estimate_normals

COUNT = 3000


@pytest.fixture(scope="module")
def ball():
    """A sphere of discs, its cameras, and the exact normals."""
    globe = scenes()[0]
    discs = surface_gaussians(globe, COUNT, torch.Generator().manual_seed(0))
    cameras = (*ring_cameras(globe, 8, 128), *ring_cameras(globe, 6, 128, elevation=-50.0))
    exact = torch.nn.functional.normalize(gradient(globe.sdf, discs.means.double()), dim=-1)
    return discs, cameras, exact.float()


def degrees_off(found, exact):
    return torch.rad2deg(torch.acos((found * exact).sum(-1).clamp(-1, 1)))


def test_normals_of_a_sphere_are_right_to_a_few_degrees(ball):
    discs, cameras, exact = ball
    found = estimate_normals(discs, cameras)
    off = degrees_off(found.directions, exact)
    assert float(off.median()) < 3
    assert float(off.quantile(0.95)) < 12
    assert float(found.confidence.median()) > 0.9


def test_normals_point_outwards_without_cameras(ball):
    discs, _, exact = ball
    off = degrees_off(estimate_normals(discs).directions, exact)
    assert float((off < 90).float().mean()) > 0.97


def test_balls_without_axes_take_the_slope_of_depth(ball):
    discs, cameras, exact = ball
    balls = replace(discs, log_scales=discs.log_scales.amax(-1, keepdim=True).expand(-1, 3) - 0.4)
    off = degrees_off(estimate_normals(balls, cameras).directions, exact)
    assert float(off.median()) < 12


def test_needles_at_random_are_less_sure_than_a_surface(ball):
    discs, cameras, _ = ball
    of_needles = estimate_normals(needles(COUNT), cameras).confidence.median()
    assert float(of_needles) < 0.6 < float(estimate_normals(discs, cameras).confidence.median())


def test_a_turned_scene_has_turned_normals(ball):
    discs, cameras, _ = ball
    away = rotate_axis((1, 2, 3, 50.0)).after(translate((5, -3, 2)))
    moved, poses = transform(discs, away), [moved_camera(each, away) for each in cameras]
    a = estimate_normals(discs, cameras).directions @ torch.from_numpy(away.turn.T).float()
    b = estimate_normals(moved, poses).directions
    assert float(degrees_off(a, b).quantile(0.98)) < 0.5
