"""Sides that a number divides: what is added, and that nothing else moves."""

from __future__ import annotations

import pytest
import torch

from gsedit.datasets.padding import pad_camera, pad_to, pad_to_multiple
from rasterizer import Camera


def picture(height: int, width: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(2, height, width, 3, generator=generator)


def test_a_mirror_image_is_reflected_as_often_as_it_takes():
    row = torch.tensor([1.0, 2, 3]).reshape(1, 1, 3, 1)
    assert pad_to_multiple(row, 4, "mirror")[0, 0, :, 0].tolist() == [1, 2, 3, 3]
    assert pad_to_multiple(row, 8, "mirror")[0, 7, :, 0].tolist() == [1, 2, 3, 3, 2, 1, 1, 2]
    assert pad_to_multiple(row, 8, "mirror").shape == (1, 8, 8, 1)


@pytest.mark.parametrize(("height", "width"), [(5, 7), (8, 7), (1, 1)])
def test_edges_are_repeated_as_torch_does(height, width):
    images = picture(height, width)
    below, right = -height % 8, -width % 8
    planes = images.movedim(-1, 1)
    expected = torch.nn.functional.pad(planes, (0, right, 0, below), mode="replicate")
    assert torch.equal(pad_to_multiple(images, 8, "edge"), expected.movedim(1, -1))
    assert torch.equal(pad_to_multiple(planes, 8, "edge", axis=2), expected)


def test_a_constant_fills_what_is_added():
    labels = torch.arange(6).reshape(1, 2, 3)
    padded = pad_to(labels, 3, 5, "constant", value=-1)
    assert padded.dtype == labels.dtype
    assert torch.equal(padded, torch.nn.functional.pad(labels, (0, 2, 0, 1), value=-1))


def test_a_camera_sees_the_same_pixels_and_more():
    camera = Camera(torch.eye(4), 50.0, 50.0, 31.0, 20.0, width=62, height=41)
    padded = pad_camera(camera, 8)
    assert (padded.width, padded.height) == (64, 48)
    assert torch.equal(padded.pixel_centers()[:41, :62], camera.pixel_centers())
