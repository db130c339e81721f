"""Coarse photos are smaller, not tiny; photos that are too small for the loss are refused."""

from __future__ import annotations

import pytest

from gsedit import Dataset, FitSettings, fit
from gsedit.bench.synthetic import ring_cameras, scenes, traced_dataset
from gsedit.errors import UsageError


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
