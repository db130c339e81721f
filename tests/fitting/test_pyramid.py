"""Coarse photos are smaller, not tiny; photos that are too small for the loss are refused."""

from __future__ import annotations

import pytest
import torch

from gsedit import Dataset, FitSettings, View, fit
from gsedit.errors import UsageError
from gsedit.fitting.fit import pyramid
from gsedit.synthetic import ring_cameras, scenes, traced_dataset

CAMERA = ring_cameras(scenes()[0], 1, 8)[0]


def view(width: int, height: int) -> View:
    return View("a", CAMERA.resized(width, height), torch.rand(height, width, 3))


@pytest.mark.parametrize(
    ("size", "half", "quarter"),
    [
        ((256, 192), (128, 96), (64, 48)),
        ((70, 66), (35, 33), (35, 33)),
        ((63, 63), (63, 63), (63, 63)),
        ((9, 10), (9, 10), (9, 10)),
        ((200, 18), (100, 9), (200, 18)),
    ],
)
def test_a_coarse_photo_is_never_larger_and_never_tiny(size, half, quarter):
    whole = view(*size)
    found = pyramid([whole], (4, 2))
    assert found[1] == (whole,)
    for factor, expected in ((2, half), (4, quarter)):
        (small,) = found[factor]
        assert (small.camera.width, small.camera.height) == expected
        assert small.image.shape == (expected[1], expected[0], 3)


def test_a_photo_too_small_for_the_loss_is_refused_and_fitted_without_ssim():
    photos = traced_dataset(scenes()[0], ring_cameras(scenes()[0], 4, 12), points=50)
    flat = [one.resized(12, 5) for one in photos.views]
    data = Dataset((*photos.views[:2], *flat), photos.points, photos.point_colors)
    settings = FitSettings(steps=2, seconds=None, dense_start=0)
    assert fit(photos, settings).steps == 2
    with pytest.raises(
        UsageError, match=r"has 12x5 pixels, and SSIM needs 6 .*--set dssim_weight=0"
    ):
        fit(data, settings)
    settings = FitSettings(steps=2, seconds=None, dense_start=0, dssim_weight=0.0)
    assert fit(data, settings).steps == 2
