"""The disagreement of views is that of the surface that both show."""

from __future__ import annotations

from dataclasses import replace
from math import isnan

import pytest
import torch
from research.train_small.warp_error import WarpError, warp_error

from gsedit.measures.metrics import rmse
from rasterizer import look_at


def picture(*shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


UP = torch.tensor([0.0, -1.0, 0.0])


def wall(views=3, step=4):
    """Cameras that slide along a wall at depth 4 by whole pixels: the warp is exact there."""
    first = look_at(torch.zeros(3), torch.tensor([0.0, 0.0, 4.0]), UP, 40.0, 64, 64)
    cameras = []
    for i in range(views):
        pose = first.world_to_camera.clone()
        pose[0, 3] -= i * step * 4.0 / first.fx
        cameras.append(replace(first, world_to_camera=pose))
    texture = picture(64, 64 + views * step, 3)
    images = torch.stack([texture[:, i * step : i * step + 64] for i in range(views)])
    depths = torch.full((views, 64, 64), 4.0, dtype=torch.float64)
    return images, cameras, depths, torch.ones(views, 64, 64)


def test_views_of_one_texture_agree():
    measured = warp_error(*wall())
    assert measured.pairs == ((0, 1), (0, 2), (1, 2))
    # the sample grid is at whole pixels up to float64 rounding, texture differences are below 1
    assert max(measured.rmse) < 1e-9
    assert measured.coverage == pytest.approx((60 / 64, 56 / 64, 60 / 64), abs=1 / 64)


def test_a_view_of_another_color_has_the_error():
    images, *rest = wall()
    images[2] += 0.3
    measured = warp_error(images, *rest)
    assert measured.rmse == pytest.approx((0, 0.3, 0.3), abs=1e-9)
    covered = measured.coverage
    expected = 0.3 * ((covered[1] + covered[2]) / sum(covered)) ** 0.5
    assert measured.mean == pytest.approx(expected, rel=1e-9)


def test_independent_noise_of_two_views_adds_up():
    images, *rest = wall(2)
    noise = 0.1 * torch.randn(2, 64, 64, 3, generator=torch.Generator().manual_seed(0)).double()
    single = warp_error(images + noise, *rest).mean
    # two independent draws differ by 0.1 sqrt(2); 10 000 samples: 1 % at one sigma
    assert single == pytest.approx(0.1 * 2**0.5, rel=0.04)
    strength = rmse(images + noise, images)
    assert strength == pytest.approx(0.1, rel=0.03)


def test_chosen_pairs_and_pairs_that_share_nothing():
    images, cameras, depths, alphas = wall()
    measured = warp_error(images, cameras, depths, alphas, pairs=[(1, 0), (2, 1)])
    assert measured.pairs == ((1, 0), (2, 1))
    nothing = warp_error(images, cameras, 0 * depths, alphas)
    assert nothing.coverage == (0, 0, 0)
    assert all(map(isnan, nothing.rmse))
    assert isnan(nothing.mean)
    assert isnan(warp_error(images[:1], cameras[:1], depths[:1], alphas[:1]).mean)


def test_pairs_without_common_pixels_do_not_spoil_the_mean():
    measured = WarpError(((0, 1), (0, 2)), (0.2, float("nan")), (0.5, 0.0))
    assert measured.mean == pytest.approx(0.2)
