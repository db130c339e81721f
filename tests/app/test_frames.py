"""Pictures that a tab gets: sizes, the newest camera, two scenes, short work."""

import time
from dataclasses import replace
from threading import Event

import numpy as np
import pytest
import torch
from closeness import EPS32, assert_near

from gsedit.app.frames import (
    FAST,
    LEAST_SIDE,
    DisplayState,
    LatestOnlyWorker,
    Painter,
    next_side,
    picture,
)
from gsedit.app.tab import camera_of, eye_of
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.select.region import tinted


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 600, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def camera():
    return ring_cameras(demo_scene(), 3, 64)[0].resized(80, 64)


@pytest.mark.parametrize("cost", [1e-9, 2e-7, 1e-6, 1e-3])
def test_the_size_settles_where_frames_take_the_wanted_time(cost):
    side = 640.0
    for _ in range(60):
        side = next_side(side, cost * side**2, 1 / FAST, 1280)
    seconds = cost * side**2
    assert side in (LEAST_SIDE, 1280) or seconds == pytest.approx(0.85 / FAST, rel=0.05)
    assert LEAST_SIDE <= side <= 1280


def test_a_painter_draws_the_newest_camera_and_rests_in_full(camera):
    gate, drawn, sent, errors = Event(), [], [], []

    def draw(asked):
        drawn.append((float(asked.cx), asked.width))
        gate.wait(5)
        return np.zeros((asked.height, asked.width, 3), np.uint8)

    large = camera.resized(800, 640)
    seen = [large]
    painter = Painter(
        lambda: seen[-1], draw, lambda _, quality: sent.append(quality), lambda: 10, errors.append
    )
    painter.rate = replace(painter.rate, side=400.0)
    for shift in range(5):
        seen.append(replace(large, cx=large.cx + shift))
        painter.look()
        time.sleep(0.02)  # the first is being drawn meanwhile
    gate.set()
    while len(drawn) < 3:
        time.sleep(0.01)
    time.sleep(0.1)
    painter.end()
    assert len(drawn) == 3  # the first, the newest coarse, the newest in full
    assert drawn[1][0] / drawn[1][1] == pytest.approx(drawn[2][0] / drawn[2][1])
    assert drawn[1][1] < 800
    assert drawn[2][1] == 800
    assert sent[-1] > sent[0]
    assert not errors


def test_a_wipe_shows_each_scene_on_its_side(scene, camera):
    red = tinted(scene, torch.ones(len(scene), dtype=torch.bool), (1.0, 0.0, 0.0))
    one, other = (picture(DisplayState(each), camera) for each in (scene, red))
    both = picture(DisplayState(red, before=scene, wipe=0.4), camera)
    assert (both[:, :30] == one[:, :30]).all()
    assert (both[:, 34:] == other[:, 34:]).all()
    assert (both[:, 32] == 255).all()
    assert (picture(DisplayState(red, before=scene, wipe=0.0), camera) == other).all()
    assert (picture(DisplayState(red, before=scene, wipe=1.0), camera) == one).all()


def test_two_scenes_beside_each_other_are_seen_from_one_place(scene, camera):
    both = picture(DisplayState(scene, before=scene, way="beside"), camera)
    assert both.shape == (64, 80, 3)
    assert np.abs(both[:, 2:38].astype(int) - both[:, 42:78]).max() <= 1


def test_a_viser_camera_is_the_renderers(camera):
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(camera.rotation.T.numpy()).as_quat()
    fov = 2 * np.arctan(camera.height / 2 / camera.fy)
    same = camera_of(np.array([w, x, y, z]), camera.center.numpy(), fov, (80, 64), 0.01)
    assert_near(same.world_to_camera, camera.world_to_camera, EPS32)
    assert same.fy == pytest.approx(camera.fy)
    eye = eye_of(camera, 2.0)
    ahead = (torch.tensor(eye.target) - torch.tensor(eye.position)).double()
    torch.testing.assert_close(ahead, 2 * camera.forward.double(), atol=1e-5, rtol=1e-5)


def test_of_short_work_only_the_newest_of_a_key_counts():
    gate, begun, got, errors = Event(), Event(), [], []
    worker = LatestOnlyWorker(errors.append)

    def first():
        begun.set()
        gate.wait(5)
        return "old"

    worker.ask("say", first, got.append)
    begun.wait(5)
    worker.ask("say", lambda: "middle", got.append)
    worker.ask("say", lambda: "new", got.append)
    worker.ask("other", lambda: 1 / 0, got.append)
    worker.ask("last", lambda: "last", got.append)
    gate.set()
    while "last" not in got:
        time.sleep(0.01)
    worker.end()
    assert got == ["new", "last"]
    assert [type(each) for each in errors] == [ZeroDivisionError]
