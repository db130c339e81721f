"""A fit keeps its Gaussians as wide as its photos can tell, and without needles."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import pytest
import torch
from point_clouds import ball
from small_scenes import generator, scenes, traced_dataset

from gsedit import Event, FitSettings, fit_steps
from gsedit.bench.synthetic import ring_cameras
from gsedit.capture.fitting.optimizer import LEAST_WIDTH, LENGTH_A_PIXEL, hold_shapes
from gsedit.scene.framing import finest_pixels


def photos(count: int = 16, size: int = 48):
    """A globe, and points on it."""
    return traced_dataset(scenes()[0], ring_cameras(scenes()[0], count, size), points=500)


def test_the_nearest_camera_that_sees_a_place_has_the_finest_pixel_there():
    near = photos(4, 32).views[0].camera
    far = replace(near, world_to_camera=near.world_to_camera.clone())
    far.world_to_camera[2, 3] += 3.0
    place, behind = (near.center + at * near.forward for at in (2.0, -10.0))
    found = finest_pixels(torch.stack((place, behind)), (far, near))
    assert found.tolist() == pytest.approx([2.0 / near.fx, 0.0], rel=1e-5)


def test_shapes_are_held_and_others_stay():
    scales = torch.tensor([[0.4, 0.4, 50], [0.01, 1, 2], [1, 2, 15], [0.1, 0.1, 50], [1, 1, 50]])
    pixels = torch.tensor([1.0, 1.0, 1.0, 1.0, 0.0])
    hold_shapes(log_scales := scales.log(), pixels)
    long, least = LENGTH_A_PIXEL * 0.4, LEAST_WIDTH
    expected = [[0.4, 0.4, long * 0.4], [least, 1, 2], [1, 2, 15], [least, least, 0.9], [1, 1, 50]]
    torch.testing.assert_close(log_scales.exp(), torch.tensor(expected))


def test_a_fit_ends_with_allowed_shapes():
    data = photos()
    start = replace(ball(200), log_scales=torch.tensor([-7.0, -3.0, -1.0]).repeat(200, 1))
    settings = FitSettings(steps=40, densify_every=10)
    *_, result = fit_steps(data, settings, generator=generator(), start=start)
    cameras = [view.camera for view in data.split()[0]]
    pixels, scales = finest_pixels(result.scene.means, cameras), result.scene.scales.sort(-1).values
    assert (scales[:, 0] > 0.9 * LEAST_WIDTH * pixels).all()  # positions moved since
    assert (scales[:, 2] * pixels < 1.1 * LENGTH_A_PIXEL * scales[:, 1].square()).all()


def test_the_time_left_counts_what_finer_photos_cost():
    seconds = count().__next__
    settings = FitSettings(steps=40, dense_start=0, coarse=((0.5, 16),), report_every=10)
    steps = fit_steps(photos(8, 120), settings, generator=generator(), clock=seconds)
    left = {e.step: e.left for e in steps if isinstance(e, Event)}
    pace = left[30] / 10  # a fine step, as counted from the mean of coarse and fine ones
    assert left[10] > 20 * pace
    assert left[40] == 0 < left[30] < left[20] < left[10]
