"""Counts of contributing pairs against the definition, a Gaussian at a time."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from research.renderer import pairs, targets
from research.renderer.contributing import contributing_pairs
from research.renderer.workloads import cloud

from gsedit.bench.renderer import speed
from rasterizer.numerics import DEFAULT


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


@pytest.mark.parametrize("stop", [0.0, 0.3])
def test_contributing_pairs_are_those_of_the_sum_pixel_by_pixel(tiny, stop):
    """Against the definition: every Gaussian at every pixel, front to back, in float64."""
    numerics = replace(DEFAULT, transmittance_min=stop)
    scene, view = tiny.scene.to(torch.float64), tiny.camera
    binned = pairs.bin_gaussians(scene, view, numerics)
    front = binned.bins.rank.argsort()
    offset = view.pixel_centers()[:, :, None] - binned.xy[front]
    w0, w1, w2 = binned.whitening[front].unbind(-1)
    u, v = w0 * offset[..., 0], w1 * offset[..., 0] + w2 * offset[..., 1]
    alpha = (
        (binned.log_opacities[front] - 0.5 * (u * u + v * v)).exp().clamp_max(numerics.alpha_max)
    )
    alpha = torch.where(alpha >= numerics.alpha_min, alpha, 0.0)
    passed = torch.cat((torch.ones_like(alpha[..., :1]), (1 - alpha).cumprod(-1)[..., :-1]), -1)
    wanted = int(((alpha > 0) & (passed > stop)).sum())
    assert 0 < wanted < alpha.numel()
    assert contributing_pairs(scene, view, numerics) == wanted


def test_the_stop_and_the_floor_leave_pairs_out(tiny):
    def count(**numbers):
        return contributing_pairs(tiny.scene, tiny.camera, replace(DEFAULT, **numbers))

    assert count(transmittance_min=0.5) < count()
    assert count(alpha_min=0.1) < count()


def test_clouds_have_the_same_work_a_gaussian_at_every_size():
    small, large = (cloud(n, *targets.pixels_for(n)) for n in (2_000, 8_000))
    a, b = (contributing_pairs(w.scene, w.camera) / len(w.scene) for w in (small, large))
    assert a == pytest.approx(b, rel=0.1)  # borders, and the draw of some thousand sizes


def test_an_empty_scene_has_no_contributing_pairs(tiny):
    assert contributing_pairs(tiny.scene[:0], tiny.camera) == 0
