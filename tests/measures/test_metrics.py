"""Laws of the metrics: each number is what its name says, on pictures whose error is known."""

from dataclasses import replace
from math import inf, isnan, log10

import pytest
import torch

from gsedit.errors import UsageError
from gsedit.measures.metrics import WarpError, edit_strength, leakage, psnr, rmse, ssim, warp_error
from rasterizer.camera import look_at


def picture(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed)).double()


def test_a_known_offset_has_a_known_error():
    image = picture(8, 8, 3)
    assert rmse(image + 0.1, image) == pytest.approx(0.1, rel=1e-12)
    assert psnr(image + 0.1, image) == pytest.approx(20.0, rel=1e-12)
    assert psnr(image, image) == inf


def test_psnr_counts_decibels_of_the_error():
    image, noise = picture(8, 8, 3), picture(8, 8, 3, seed=1)
    difference = psnr(image + noise / 10, image) - psnr(image + noise, image)
    assert difference == pytest.approx(20, rel=1e-9)
    assert psnr(noise, image) == pytest.approx(-20 * log10(rmse(noise, image)))


def test_a_mask_measures_inside_only():
    image, mask = picture(2, 8, 8, 3), torch.zeros(2, 8, 8, dtype=torch.bool)
    mask[:, :4] = True
    edited = image + 0.2 * mask[..., None]
    assert edit_strength(image, edited, mask) == pytest.approx(0.2)
    assert leakage(image, edited, mask) == 0
    assert edit_strength(image, edited) == pytest.approx(0.2 / 2**0.5)
    assert leakage(image, edited, ~mask) == pytest.approx(0.2)
    with pytest.raises(UsageError, match="selects no pixel"):
        rmse(image, edited, torch.zeros_like(mask))


def test_ssim_is_one_for_equal_pictures_and_falls_with_noise():
    image = torch.linspace(0, 1, 32).double()[:, None, None].expand(32, 32, 3)
    noise = picture(32, 32, 3) - 0.5
    assert ssim(image, image) == pytest.approx(1)
    assert 1 > ssim(image + 0.05 * noise, image) > ssim(image + 0.2 * noise, image) > 0


# ---- agreement between views ---------------------------------------------------------------------

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


def test_a_view_of_another_colour_has_the_error():
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
    strength = edit_strength(images, images + noise)
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
