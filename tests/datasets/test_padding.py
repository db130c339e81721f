"""Sides that a number divides: what is added, and that nothing else moves."""

from __future__ import annotations

import torch

from gsedit.views.image_ops import pad_camera, pad_to_multiple
from rasterizer import Camera


def test_a_mirror_image_is_reflected_as_often_as_it_takes():
    row = torch.tensor([1.0, 2, 3]).reshape(1, 1, 3, 1)
    assert pad_to_multiple(row, 4, "mirror")[0, 0, :, 0].tolist() == [1, 2, 3, 3]
    assert pad_to_multiple(row, 8, "mirror")[0, 7, :, 0].tolist() == [1, 2, 3, 3, 2, 1, 1, 2]
    assert pad_to_multiple(row, 8, "mirror").shape == (1, 8, 8, 1)


def test_a_camera_sees_the_same_pixels_and_more():
    camera = Camera(torch.eye(4), 50.0, 50.0, 31.0, 20.0, width=62, height=41)
    padded = pad_camera(camera, 8)
    assert (padded.width, padded.height) == (64, 48)
    assert torch.equal(padded.pixel_centers()[:41, :62], camera.pixel_centers())
