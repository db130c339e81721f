"""Scenes without cameras are framed upright, by their bulk."""

import math

import pytest
import torch
from point_clouds import ball, cloud

from gsedit.errors import UsageError
from gsedit.scene import framing


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_framing_camera_sees_the_scene_upright(axis):
    scene = ball()
    up = framing.up_vector(axis)
    camera = framing.framing_camera(scene, up=up, size=(64, 48))
    xy, depth = camera.project(scene.means.double())
    inside = (depth > 0) & (xy > 0).all(1) & (xy < torch.tensor([64, 48])).all(1)
    assert inside.float().mean() > 0.8
    feet = camera.center + 5 * camera.forward
    (foot_x, foot_y), (head_x, head_y) = camera.project(torch.stack((feet, feet + up)))[0]
    assert head_y < foot_y  # y points down in a picture
    assert abs(head_x - foot_x) < 1e-10  # upright: float64 rounding of 64 pixels


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (-0.6, 0.48, 0.64)])
def test_up_is_off_the_ground_whatever_the_frame(up):
    generator = torch.Generator().manual_seed(0)
    normal = torch.tensor(up, dtype=torch.float64)
    ground = torch.randn(2000, 3, generator=generator, dtype=torch.float64)
    ground = ground - (ground @ normal)[:, None] * normal
    body = 0.3 * torch.randn(1000, 3, generator=generator, dtype=torch.float64) + 0.9 * normal
    guess = framing.guess_up(cloud(torch.cat((ground, body))))
    assert guess @ normal > math.cos(math.radians(8))  # 400 directions: about 7 degrees apart


def test_a_capture_is_framed_by_its_dense_middle():
    generator = torch.Generator().manual_seed(2)
    middle = torch.randn(1000, 3, generator=generator)
    surroundings = 40 * torch.randn(300, 3, generator=generator)
    assert framing.bounds(cloud(torch.cat((middle, surroundings)))).radius < 6
    assert framing.bounds(cloud(middle)).radius > 2


def test_the_framing_camera_stands_and_looks_where_it_is_told():
    eye, target = torch.tensor([3.0, 1, 1]).double(), torch.tensor([0.0, 0.2, 0]).double()
    up = framing.up_vector("z")
    camera = framing.framing_camera(ball(), up=up, eye=eye, target=target, size=(64, 48))
    assert torch.allclose(camera.center, eye)
    aim, _ = camera.project(target)
    assert torch.allclose(aim, torch.tensor([32.0, 24.0]).double())
    with pytest.raises(UsageError, match="stands where it looks"):
        framing.framing_camera(ball(), up=up, eye=eye, target=eye)
