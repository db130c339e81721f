"""How much pictures of a scene change when it is simplified."""

from __future__ import annotations

from collections.abc import Sequence

from gsedit.cameras.orbit import orbit
from gsedit.measures.metrics import psnr
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
    import torch

    scene, other = gaussians_of(before), gaussians_of(after)
    if cameras is None:
        cameras = orbit(scene, VIEWS, SIZE)
    chosen = cameras[:: -(-len(cameras) // VIEWS)]
    pictures = []
    for camera in (each.fitted(SIZE) for each in chosen):
        pictures.append(torch.stack([render_picture(each, camera) for each in (other, scene)]))
    stacks = [p.reshape(2, -1, 1, 3) for p in pictures]
    whole = torch.cat(stacks, 1)
    return psnr(whole[0], whole[1])


def describe_change(
    before: SplatTable, after: SplatTable, cameras: Sequence[Camera] | None = None
) -> str:
    """Describe in one line, for a person, how much pictures changed."""
    where = "an orbit" if cameras is None else "the given cameras"
    number = f"{picture_change(before, after, cameras):.2f}"
    return f"pictures from {where} keep {number} dB (PSNR against those before)"
