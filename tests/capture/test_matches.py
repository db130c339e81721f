"""SIFT matches of pictures whose correspondence is known."""

import pytest
import torch

from gsedit.capture.matches import match_pictures
from rasterizer.camera import Camera


@pytest.fixture(scope="module")
def texture():
    """A picture of blobs of many sizes."""
    random = torch.Generator().manual_seed(0)
    layers = [
        torch.nn.functional.interpolate(
            torch.rand(1, 1, side, side, generator=random), (300, 300), mode="bicubic"
        )
        for side in (10, 25, 60)
    ]
    return (sum(layers)[0, 0] / 3).clamp(0, 1)


def camera(width=256, height=256):
    return Camera(torch.eye(4, dtype=torch.float64), 300.0, 300.0, 128.0, 128.0, width, height)


def test_a_moved_picture_has_points_that_moved_as_it_did(texture):
    views = {3: texture[:256, :256], 5: texture[9:265, 14:270], 8: 0 * texture[:256, :256]}
    pictures = {i: view[..., None].expand(-1, -1, 3) for i, view in views.items()}
    cameras = dict.fromkeys(pictures, camera())
    found = match_pictures(pictures, cameras, [(3, 5), (3, 8)])
    assert set(found) == {(3, 5)}  # nothing is seen in the black one
    here, there = found[3, 5]
    assert len(here) > 100
    moved = (here - there).median(0).values
    assert moved.tolist() == pytest.approx([14, 9], abs=0.05)
