"""Views of a person: what all cameras look at, what is framed, what is numbered."""

from dataclasses import replace

import pytest
import torch
from playroom import playroom

from gsedit.app.looking import best_of, framed, marks
from gsedit.app.tab import eye_of
from gsedit.select.click import Selector
from rasterizer.camera import look_at

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def at(place, target=(0.0, 0.0, 0.0)):
    eye, middle = (torch.tensor(each, dtype=torch.float64) for each in (place, target))
    return look_at(eye, middle, UP, 50.0, 64, 48)


def test_the_best_view_is_no_close_one_none_from_below_and_none_that_looks_aside():
    close, below, aside = at((0.5, 0, 0.2)), at((0, 4, -3)), at((-4, 0, 1.2), (-4, 3, 1.2))
    best = at((4.0, 0.0, 1.2))
    usual = [at((0.0, 4.0, 3.0)), at((0.0, -4.0, 3.0))]
    cameras = [close, below, aside, best, *usual]
    assert best_of(cameras, torch.zeros(3, dtype=torch.float64), UP) is best


def test_what_is_framed_is_in_the_middle_and_fills_the_picture():
    room, camera = playroom(), playroom().cameras[0]
    ball = room.of("red ball")
    eye = framed(room.scene, ball, eye_of(camera, 3.0))
    seen = look_at(
        torch.tensor(eye.position).double(), torch.tensor(eye.target).double(),
        torch.tensor(eye.up).double(), 57.2958 * eye.fov, 100, 100,
    )  # fmt: skip
    places = seen.project(room.scene.means[ball])[0]
    assert places.mean(0).tolist() == pytest.approx([50, 50], abs=8)
    size = float((places.amax(0) - places.amin(0)).max())
    assert 40 < size < 95


def test_numbers_are_on_the_objects_that_are_seen():
    room, camera = playroom(), playroom().cameras[0]
    segments = Selector(room.scene, room.cameras).segments
    found = marks(room.scene, segments, camera)
    assert found
    for each in found:
        assert 0 < each.x < 1
        assert 0 < each.y < 1
        inside = segments.inside(each.number)
        x, y = camera.project(room.scene.means[inside].mean(0)[None])[0][0].tolist()
        assert abs(each.x - x / camera.width) < 0.15
        assert abs(each.y - y / camera.height) < 0.15
    turned = torch.diag(torch.tensor([-1.0, 1, -1, 1])) @ camera.world_to_camera.float()
    assert marks(room.scene, segments, replace(camera, world_to_camera=turned)) == ()
