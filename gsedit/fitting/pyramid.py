"""The photos of a fit, and the same with fewer pixels for its first steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gsedit.datasets.dataset import View
from gsedit.datasets.lazy_views import PixelCache
from gsedit.errors import UsageError
from gsedit.fitting.photometric import SMALLEST
from gsedit.fitting.settings import FitSettings

SMALLEST_COARSE = 32
"""Pixels on the longer side: a coarse picture has no fewer, whatever its factor."""


def check_sizes(views: Sequence[View], settings: FitSettings) -> None:
    """Raise UsageError for a photo that is too small for the loss."""
    small = min(views, key=lambda view: min(view.camera.width, view.camera.height))
    width, height = small.camera.width, small.camera.height
    if settings.dssim_weight and min(width, height) < SMALLEST:
        raise UsageError(
            f"{small.name} has {width}x{height} pixels, and SSIM needs {SMALLEST} a side: fit to "
            "larger photos, or give --set dssim_weight=0"
        )


def pyramid(views: Sequence[View], factors: Iterable[int]) -> dict[int, tuple[View, ...]]:
    """By factor, 1 among them: the views on grids so many times coarser, made when they are first
    needed. A view whose coarse picture would be too small is made less coarse, or stays."""
    kept = PixelCache()
    return {
        factor: tuple(_coarse(view, factor, kept) for view in views) for factor in (1, *factors)
    }


def _coarse(view: View, factor: int, kept: PixelCache) -> View:
    camera = view.camera
    sides = (camera.width, camera.height)
    factor = max(1, min(factor, max(sides) // SMALLEST_COARSE))
    if min(sides) // factor < SMALLEST:
        return view
    return kept.resized(view, *(side // factor for side in sides))
