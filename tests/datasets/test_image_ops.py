"""Pictures made smaller keep their mean; hue rotations keep greys and lengths; sides are padded."""

import pytest
import torch

from gsedit.views.image_ops import downscale, pad_camera, pad_to_multiple, rotate_hue
from rasterizer import Camera


@pytest.mark.parametrize("size", [(4, 3), (5, 4), (1, 1), (8, 6)])
def test_downscale_keeps_mean_range_and_constants(size):
    photo = torch.rand(6, 8, 3, generator=torch.Generator().manual_seed(0))
    small = downscale(photo, *size)
    assert small.shape == (size[1], size[0], 3)
    torch.testing.assert_close(small.mean((0, 1)), photo.mean((0, 1)))
    torch.testing.assert_close(downscale(torch.ones(6, 8, 3), *size), torch.ones(*small.shape))


def test_a_third_of_a_turn_permutes_the_channels():
    colors = torch.rand(5, 4, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(rotate_hue(colors, 120.0), colors.roll(1, -1))


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
