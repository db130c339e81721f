"""Counts of pairs, and the alphas near the floor."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from research.renderer import pairs
from research.renderer.workloads import cloud
from scenes import camera, gaussian

from gsedit.bench.renderer import speed
from rasterizer.numerics import AUTO, DEFAULT


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


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
    offset = view.pixel_centers() - binned.xy[0]
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
