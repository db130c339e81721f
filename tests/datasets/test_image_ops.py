"""Pictures made smaller keep their mean; hue rotations keep greys and lengths; even spacing."""

from __future__ import annotations

import pytest
import torch

from gsedit.views.image_ops import downscale, rotate_hue


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
