"""Cameras around a scene that has none stand where a person would."""

from __future__ import annotations

import math

import pytest
import torch
from point_clouds import ball, cloud

from gsedit.errors import UsageError
from gsedit.views import framing
from rasterizer.render import render


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_framing_camera_sees_the_scene_upright(axis):
    scene = ball()
    up = framing.up_vector(axis)
    camera = framing.framing_camera(scene, up=up, size=(64, 48))
    xy, depth = camera.project(scene.means.double())
    inside = (depth > 0) & (xy > 0).all(1) & (xy < torch.tensor([64, 48])).all(1)
    assert inside.float().mean() > 0.8
    feet = camera.centre + 5 * camera.forward
    (foot_x, foot_y), (head_x, head_y) = camera.project(torch.stack((feet, feet + up)))[0]
    assert head_y < foot_y  # y points down in a picture
    assert abs(head_x - foot_x) < 1e-10  # upright: float64 rounding of 64 pixels


def test_framing_does_not_mind_far_floaters():
    scene = ball(2000)
    far = cloud(torch.cat((scene.means, 1e4 * torch.ones(5, 3))))
    here, there = (
        framing.framing_camera(s, up=framing.up_vector("z")).centre for s in (scene, far)
    )
    assert (here - there).norm() < 0.1 * here.norm()


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (-0.6, 0.48, 0.64)])
def test_up_is_off_the_ground_whatever_the_frame(up):
    generator = torch.Generator().manual_seed(0)
    normal = torch.tensor(up, dtype=torch.float64)
    ground = torch.randn(2000, 3, generator=generator, dtype=torch.float64)
    ground = ground - (ground @ normal)[:, None] * normal
    body = 0.3 * torch.randn(1000, 3, generator=generator, dtype=torch.float64) + 0.9 * normal
    guess = framing.guess_up(cloud(torch.cat((ground, body))))
    assert guess @ normal > math.cos(math.radians(8))  # 400 directions: about 7 degrees apart


def test_up_is_inrias_where_there_is_no_ground():
    assert framing.guess_up(ball(2000)).tolist() == [0, -1, 0]


def test_an_orbit_stands_around_the_scene_and_sees_all_of_it():
    scene = ball()
    up = torch.tensor([0.3, 0.5, 0.8], dtype=torch.float64)
    cameras = framing.orbit(scene, 7, 64, up=up, elevation=30.0)
    centre = torch.tensor(framing.bounds(scene).centre, dtype=torch.float64)
    offsets = torch.stack([c.centre - centre for c in cameras])
    heights = offsets @ up / up.norm()
    distances = offsets.norm(dim=1)
    assert (distances - distances[0]).abs().max() < 1e-9 * distances[0]
    assert torch.allclose(heights, distances * math.sin(math.radians(30)))
    for camera in cameras:
        xy, depth = camera.project(scene.means.double())
        assert ((xy > 0) & (xy < 64)).all(1).double().mean() > 0.95
        assert (depth > 0).all()


def test_a_capture_is_framed_by_its_dense_middle():
    generator = torch.Generator().manual_seed(2)
    middle = torch.randn(1000, 3, generator=generator)
    surroundings = 40 * torch.randn(300, 3, generator=generator)
    assert framing.bounds(cloud(torch.cat((middle, surroundings)))).radius < 6
    assert framing.bounds(cloud(middle)).radius > 2


def test_a_single_gaussian_is_framed_by_its_size():
    (camera,) = framing.orbit(ball(1), 1, 32, up=framing.up_vector("z"))
    assert render(ball(1), camera).alpha.max() > 0.5


@pytest.mark.parametrize("axis", ["w", "", "--x", "xy"])
def test_a_wrong_axis_is_refused(axis):
    with pytest.raises(UsageError, match="-z"):
        framing.up_vector(axis)


def test_an_empty_scene_has_no_frame():
    with pytest.raises(UsageError, match="no Gaussians"):
        framing.framing_camera(ball()[:0])


def test_up_may_be_in_any_precision_and_of_any_length():
    exact = framing.orbit(ball(50), 2, 32, up=framing.up_vector("z"))
    for up in (torch.tensor([0.0, 0.0, 3.0]), torch.tensor([0.0, 0.0, 1.0]).half()):
        for camera, expected in zip(framing.orbit(ball(50), 2, 32, up=up), exact):
            torch.testing.assert_close(camera.world_to_camera, expected.world_to_camera)


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (0.0, float("nan"), 1.0)])
def test_what_is_no_direction_is_refused_as_up(up):
    with pytest.raises(UsageError, match=r"is no direction: three finite numbers, not all 0"):
        framing.orbit(ball(50), 2, 32, up=torch.tensor(up))
