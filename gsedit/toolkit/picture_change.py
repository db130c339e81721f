"""How much pictures of a scene change when it is simplified."""

from __future__ import annotations

from collections.abc import Sequence

from gsedit.cameras.orbit import orbit
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import pooled_rmse, squared_error
from gsedit.scene.picture import render_picture
from gsedit.scene.table import SplatTable, gaussians_of
from rasterizer.camera import Camera

SIZE = 256
"""Longer side of the pictures, pixels."""
VIEWS = 8


def picture_change(
    before: SplatTable, after: SplatTable, cameras: Sequence[Camera] | None = None
) -> float:
    """PSNR, dB, of the pictures of `after` against those of `before`, over black.

    Of up to VIEWS of `cameras`, evenly chosen; of an orbit around `before` if None.
    """
    scene, other = gaussians_of(before), gaussians_of(after)
    cameras = orbit(scene, VIEWS, SIZE) if cameras is None else cameras
    chosen = [each.fitted(SIZE) for each in cameras[:: -(-len(cameras) // VIEWS)]]
    pairs = ((render_picture(other, each), render_picture(scene, each)) for each in chosen)
    rmse = pooled_rmse(squared_error(*pair) for pair in pairs)
    return psnr_from_rmse(rmse or 0.0)


def describe_change(
    before: SplatTable, after: SplatTable, cameras: Sequence[Camera] | None = None
) -> str:
    """Describe in one line, for a person, how much pictures changed."""
    where = "an orbit" if cameras is None else "the given cameras"
    number = f"{picture_change(before, after, cameras):.2f}"
    return f"pictures from {where} keep {number} dB (PSNR against those before)"
