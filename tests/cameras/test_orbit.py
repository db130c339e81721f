"""Cameras in a circle: as far as the ball is large, evenly spaced, upright."""

import math
from dataclasses import replace

import pytest
import torch
from point_clouds import ball

from gsedit import orbit
from gsedit.errors import UsageError
from gsedit.scene import framing
from gsedit.views.around import find_views
from gsedit.views.orbit import circle, perpendicular
from gsedit.views.search import ViewConstraints
from rasterizer import render


def test_perpendicular_vectors_are_unit_vectors_across():
    vectors = torch.cat((torch.eye(3), -torch.eye(3), torch.tensor([[0.3, -2.0, 0.1]]))).double()
    across = perpendicular(vectors)
    torch.testing.assert_close(across.norm(dim=-1), torch.ones(7, dtype=torch.float64))
    assert (vectors * across).sum(-1).abs().max() < 1e-15  # a rounding of products of size 1
    assert torch.equal(across[3], perpendicular(vectors[3]))


def test_a_circle_starts_at_its_azimuth_and_goes_counter_clockwise():
    center = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    up, east = torch.eye(3, dtype=torch.float64)[[2, 0]]
    cameras = circle(center, 0.5, up, 4, 8, elevation=0.0, fov=60.0, start=-90.0, east=east)
    offsets = torch.stack([camera.center - center for camera in cameras])
    expected = [[0.0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]]  # 0.5 / sin(30 degrees) away
    torch.testing.assert_close(offsets, torch.tensor(expected, dtype=torch.float64))


def test_an_orbit_stands_around_the_scene_and_sees_all_of_it():
    scene = ball()
    up = torch.tensor([0.3, 0.5, 0.8], dtype=torch.float64)
    cameras = orbit(scene, 7, 64, up=up, elevation=30.0)
    center = torch.tensor(framing.bounds(scene).center, dtype=torch.float64)
    offsets = torch.stack([c.center - center for c in cameras])
    heights = offsets @ up / up.norm()
    distances = offsets.norm(dim=1)
    assert (distances - distances[0]).abs().max() < 1e-9 * distances[0]
    assert torch.allclose(heights, distances * math.sin(math.radians(30)))
    for camera in cameras:
        xy, depth = camera.project(scene.means.double())
        assert ((xy > 0) & (xy < 64)).all(1).double().mean() > 0.95
        assert (depth > 0).all()


def test_a_single_gaussian_is_framed_by_its_size():
    (camera,) = orbit(ball(1), 1, 32, up=framing.up_vector("z"))
    assert render(ball(1), camera).alpha.max() > 0.5


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (0.0, float("nan"), 1.0)])
def test_what_is_no_direction_is_refused_as_up(up):
    with pytest.raises(UsageError, match=r"is no direction: three finite numbers, not all 0"):
        orbit(ball(50), 2, 32, up=torch.tensor(up))


def test_an_object_in_one_place_is_seen_from_each_elevation():
    lone = ball(3)
    huge = replace(lone, log_scales=torch.full_like(lone.log_scales, 3.0))
    up = framing.up_vector("z")
    found = find_views(huge, 6, 32, wish=ViewConstraints(up), rings=(20.0, -25.0))
    assert [float(c.forward @ up) < 0 for c in found] == [True] * 3 + [False] * 3
