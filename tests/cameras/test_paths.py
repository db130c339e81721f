"""Laws of camera paths: seamless, through their cameras, moved as their cameras are moved."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import get_args

import numpy as np
import pytest
import torch

from gsedit import camera_path
from gsedit.errors import UsageError
from gsedit.scene.framing import Bounds
from gsedit.views import PathKind
from gsedit.views.orbit import circle
from gsedit.views.paths import circle_of, common_point, spline, swing, turntable, up_of
from rasterizer import Camera, look_at

UP = torch.nn.functional.normalize(torch.tensor([0.2, -1.0, 0.1], dtype=torch.float64), dim=0)
CENTER = torch.tensor([0.5, -1.0, 2.0], dtype=torch.float64)


def ring(count: int = 12, elevation: float = 20.0) -> tuple[Camera, ...]:
    """Level cameras on a circle around CENTER."""
    return circle(CENTER, 1.0, UP, count, 64, elevation=elevation, fov=50.0)


def steps(path: tuple[Camera, ...]) -> torch.Tensor:
    """Distances between neighbors, the last to the first included."""
    eyes = torch.stack([camera.center for camera in path])
    return (eyes.roll(-1, 0) - eyes).norm(dim=-1)


def test_a_circle_of_cameras_is_found_again():
    found = circle_of(ring())
    torch.testing.assert_close(found.center, CENTER)
    torch.testing.assert_close(found.up, UP)
    assert found.elevation == pytest.approx(radians(20.0))
    for ours, theirs in zip(turntable(found, 12), ring()):
        torch.testing.assert_close(ours.world_to_camera, theirs.world_to_camera)
        assert (ours.fx, ours.width) == (theirs.fx, theirs.width)


def test_a_turntable_is_a_full_turn_of_equal_steps():
    path = turntable(circle_of(ring()), 40)
    gaps = steps(path)
    torch.testing.assert_close(gaps, gaps[:1].expand(40))
    turn = path[1].rotation.T @ path[0].rotation
    torch.testing.assert_close(torch.linalg.matrix_power(turn, 40), torch.eye(3).double())
    assert {round(float((c.center - CENTER).norm()), 6) for c in path} == {
        round(1 / np.sin(radians(25)), 6)
    }


def test_an_orbit_swings_to_both_sides_and_back():
    cameras = ring()[:5]  # all on one side: the third is in the middle
    path = swing(circle_of(cameras), 40, 60.0)
    torch.testing.assert_close(path[0].center, cameras[2].center, atol=1e-5, rtol=0)
    first, last = path[10].center - CENTER, path[30].center - CENTER
    level = [v - (v @ UP) * UP for v in (first, last)]
    cosine = torch.nn.functional.cosine_similarity(level[0], level[1], dim=0)
    assert float(cosine) == pytest.approx(0.5)  # 60 degrees
    assert float(steps(path).max()) < 0.2


def test_a_spline_passes_through_its_cameras_and_is_smooth():
    generator = np.random.default_rng(0)
    cameras = []
    for i in range(7):
        eye = torch.tensor([i + generator.normal() / 5, generator.normal() / 3, -4.0])
        cameras.append(replace(look_at(eye, CENTER, UP, 50.0, 64, 48), fx=60.0 + i, fy=60.0 + i))
    path = spline(cameras, 2001)
    eyes = torch.stack([camera.center for camera in path])
    for camera in cameras:
        nearest = path[int((eyes - camera.center).norm(dim=-1).argmin())]
        torch.testing.assert_close(
            nearest.world_to_camera, camera.world_to_camera, atol=5e-3, rtol=0
        )
        assert nearest.fx == pytest.approx(camera.fx, abs=5e-3)
    ends = torch.stack([path[0].world_to_camera, path[-1].world_to_camera])
    known = torch.stack([cameras[0].world_to_camera, cameras[-1].world_to_camera])
    torch.testing.assert_close(ends, known)
    gaps = steps(path)[:-1]
    assert float(gaps.max() / gaps.median()) < 3
    assert float(gaps.diff().abs().max() / gaps.median()) < 0.02  # no jerk at the cameras


def test_paths_move_with_their_cameras():
    random = torch.Generator().manual_seed(0)
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=random))[0]
    turn = turn * turn.det().sign()
    shift = torch.tensor([3.0, -1.0, 7.0], dtype=torch.float64)

    def moved(camera: Camera) -> Camera:
        change = torch.eye(4, dtype=torch.float64)
        change[:3, :3], change[:3, 3] = turn.T, -turn.T @ shift
        return replace(camera, world_to_camera=camera.world_to_camera @ change)

    cameras = ring(9, 35.0)[:6]
    for kind in get_args(PathKind):
        here = camera_path(kind, cameras, 5)
        there = camera_path(kind, [moved(camera) for camera in cameras], 5)
        for a, b in zip(here, there):
            torch.testing.assert_close(moved(a).world_to_camera, b.world_to_camera)


def test_up_is_that_of_cameras_that_look_down():
    torch.testing.assert_close(up_of(ring(4, 70.0)[:3]), UP)  # their own upward axes lean inward
    (one,) = ring(1, 0.0)
    torch.testing.assert_close(up_of([one]), UP)


def test_cameras_that_look_apart_have_no_common_point():
    outward = [
        look_at(torch.zeros(3), camera.center - CENTER, UP, 50.0, 64, 64) for camera in ring()
    ]
    assert common_point([replace(c) for c in ring()[:1]]) is None
    inside = [
        look_at(c.forward * 0.2, c.forward * 2, UP, 50.0, 64, 64) for c in outward
    ]  # they look away from the middle, which is behind all of them
    assert common_point(inside) is None
    with pytest.raises(UsageError, match="no common point"):
        circle_of(inside)
    around = circle_of(inside, fallback=Bounds((1.0, 2.0, 3.0), 1.0))
    assert around.center.tolist() == [1.0, 2.0, 3.0]


def test_a_path_of_cameras_in_the_middle_or_right_above_has_whole_poses():
    """A panorama, and a photo straight down: the cameras of the path are turned, not flattened."""
    middle = Bounds((0.0, 0.0, 0.0), 2.0)
    panorama = [look_at(torch.zeros(3), ahead, UP, 50.0, 64, 64) for ahead in (CENTER, -CENTER)]
    above = [look_at(3 * UP, torch.zeros(3), torch.tensor([1.0, 0.0, 0.0]), 50.0, 64, 64)]
    for cameras in (panorama, above):
        for camera in turntable(circle_of(cameras, up=UP, fallback=middle), 3):
            whole = camera.rotation @ camera.rotation.T
            torch.testing.assert_close(whole, torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"kind": "spline", "cameras": ring()[:1]}, "two cameras that differ"),
        ({"kind": "spline", "cameras": ring()[:1] * 3}, "two cameras that differ"),
        ({"kind": "turntable", "cameras": ()}, "at least one camera"),
        ({"kind": "turntable", "elevation": 90.0}, "between -90 and 90"),
        ({"kind": "orbit", "arc": 0.0}, "above 0"),
        ({"kind": "orbit", "up": torch.zeros(3)}, "no direction"),
        ({"kind": "orbit", "frames": 0}, "1 or more"),
    ],
)
def test_paths_that_make_no_sense_are_refused(words, message):
    with pytest.raises(UsageError, match=message):
        camera_path(**{"cameras": ring(), "frames": 3, **words})
