"""Laws of the metrics: each number is what its name says, on pictures whose error is known."""

from math import inf, log10

import pytest
import torch

from gsedit.errors import UsageError
from gsedit.measures.decibels import psnr_from_rmse, rmse_from_psnr
from gsedit.measures.formulas import psnr, rmse, ssim


def picture(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed)).double()


def test_a_known_offset_has_a_known_error():
    image = picture(8, 8, 3)
    assert rmse(image + 0.1, image) == pytest.approx(0.1, rel=1e-12)
    assert psnr(image + 0.1, image) == pytest.approx(20.0, rel=1e-12)
    assert psnr(image, image) == inf


def test_psnr_counts_decibels_of_the_error():
    image, noise = picture(8, 8, 3), picture(8, 8, 3, seed=1)
    assert psnr(noise, image) == pytest.approx(-20 * log10(rmse(noise, image)))


@pytest.mark.parametrize("error", [1e-12, 1e-3, 0.1, 0.5, 1.0, 2.0])
def test_decibels_and_errors_are_inverse_to_each_other(error):
    assert psnr_from_rmse(error) == pytest.approx(-20 * log10(error), abs=1e-12)
    assert rmse_from_psnr(psnr_from_rmse(error)) == pytest.approx(error, rel=1e-12)


def test_a_mask_measures_inside_only():
    image, mask = picture(2, 8, 8, 3), torch.zeros(2, 8, 8, dtype=torch.bool)
    mask[:, :4] = True
    edited = image + 0.2 * mask[..., None]
    assert rmse(edited, image, mask) == pytest.approx(0.2)
    assert rmse(edited, image) == pytest.approx(0.2 / 2**0.5)
    with pytest.raises(UsageError, match="selects no pixel"):
        rmse(image, edited, torch.zeros_like(mask))


def test_ssim_is_one_for_equal_pictures_and_falls_with_noise():
    image = torch.linspace(0, 1, 32).double()[:, None, None].expand(32, 32, 3)
    noise = picture(32, 32, 3) - 0.5
    assert ssim(image, image) == pytest.approx(1)
    assert 1 > ssim(image + 0.05 * noise, image) > ssim(image + 0.2 * noise, image) > 0
