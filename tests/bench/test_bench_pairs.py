"""Counts of pairs against the definition, a Gaussian at a time."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from scenes import camera, gaussian

from gsedit.bench.renderer import pairs, workloads
from rasterizer.numerics import AUTO, DEFAULT


@pytest.fixture
def tiny() -> workloads.Workload:
    return workloads.cloud(60, 24, 16)


@pytest.mark.parametrize("stop", [0.0, 0.3])
def test_contributing_pairs_are_those_of_the_sum_pixel_by_pixel(tiny, stop):
    """Against the definition: every Gaussian at every pixel, front to back, in float64."""
    numerics = replace(DEFAULT, transmittance_min=stop)
    scene, view = tiny.scene.to(torch.float64), tiny.camera
    binned = pairs.bin_gaussians(scene, view, numerics)
    front = binned.bins.rank.argsort()
    offset = view.pixel_centres()[:, :, None] - binned.xy[front]
    w0, w1, w2 = binned.whitening[front].unbind(-1)
    u, v = w0 * offset[..., 0], w1 * offset[..., 0] + w2 * offset[..., 1]
    alpha = (
        (binned.log_opacities[front] - 0.5 * (u * u + v * v)).exp().clamp_max(numerics.alpha_max)
    )
    alpha = torch.where(alpha >= numerics.alpha_min, alpha, 0.0)
    passed = torch.cat((torch.ones_like(alpha[..., :1]), (1 - alpha).cumprod(-1)[..., :-1]), -1)
    wanted = int(((alpha > 0) & (passed > stop)).sum())
    assert 0 < wanted < alpha.numel()
    assert pairs.contributing_pairs(scene, view, numerics) == wanted


def test_the_stop_and_the_floor_leave_pairs_out(tiny):
    def count(**numbers):
        return pairs.contributing_pairs(tiny.scene, tiny.camera, replace(DEFAULT, **numbers))

    assert count(transmittance_min=0.5) < count()
    assert count(alpha_min=0.1) < count()


def test_smaller_tiles_evaluate_fewer_pixels_in_more_pairs(tiny):
    few, many = (
        pairs.listed_pairs(tiny.scene, tiny.camera, execution=replace(AUTO, tile_size=side))
        for side in (4, 16)
    )
    assert few[1] == 16 * few[0]
    assert many[1] == 256 * many[0]
    assert few[0] > many[0]
    assert few[1] < many[1]


def test_an_alpha_at_the_floor_is_detected():
    """One Gaussian of opacity 1/2: on the circle where it falls to the floor, and off it."""
    view = camera()
    one = gaussian((0.0, 0.0, 2.0), (0.3, 0.3, 0.3), opacity=0.5)
    binned = pairs.bin_gaussians(one, view, DEFAULT)
    offset = view.pixel_centres() - binned.xy[0]
    w0, w1, w2 = binned.whitening[0]
    power = 0.5 * (
        (w0 * offset[..., 0]).square() + (w1 * offset[..., 0] + w2 * offset[..., 1]).square()
    )
    alpha = 0.5 * (-power).exp()
    pixels = torch.tensor([[16, 28], [0, 0], [16, 30]])
    floor = float(alpha[16, 30])  # so that the last pixel lies on the circle
    numerics = replace(DEFAULT, alpha_min=floor)
    nearest = pairs.nearest_to_floor(one, view, pixels, numerics)
    assert nearest[2] < 1e-12  # some roundings in float64
    ratio = float(alpha[16, 28] / floor)
    assert 1 < ratio < 2
    assert nearest[0] == pytest.approx(ratio - 1)
    assert nearest[1] == pytest.approx(1.0)  # nothing is near
    nothing = pairs.nearest_to_floor(one[:0], view, pixels)
    assert len(nothing) == 3
    assert nothing.min() == 1


def test_an_empty_scene_has_no_pairs(tiny):
    nothing = tiny.scene[:0]
    assert pairs.listed_pairs(nothing, tiny.camera) == (0, 0)
    assert pairs.contributing_pairs(nothing, tiny.camera) == 0
