"""The change of small pictures, carried to full size: exact where it can be, sharp at edges."""

import pytest
import torch
from closeness import EPS32, assert_near

from gsedit.measures.formulas import psnr
from gsedit.paper.guided import carry_change
from gsedit.views.image_ops import downscale

WIDTH, HEIGHT = 90, 70
SIZES = ((30, 20), (32, 25), (17, 13))
ROUNDING = 1000 * EPS32
"""A window's covariances are differences of means that are a hundred times as large."""


def shrink(images, width, height):
    return torch.stack([downscale(image, width, height) for image in images])


def noise():
    """Pictures whose pixels have nothing in common."""
    generator = torch.Generator().manual_seed(0)
    return 0.25 + 0.5 * torch.rand(2, HEIGHT, WIDTH, 3, generator=generator)


def disc(inside, outside):
    """A disc with a sharp edge, on a ground of two shades."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    is_in = ((x - 41.3) ** 2 + (y - 33.7) ** 2 < 24**2)[..., None]
    ground = torch.tensor(outside) * (0.7 + 0.3 * (x % 16 < 8))[..., None]
    return torch.where(is_in, torch.tensor(inside), ground)[None]


def interpolated(edited, original, full):
    """The difference, interpolated: what any guide must beat."""
    change = torch.nn.functional.interpolate(
        (edited - original).movedim(-1, 1), full.shape[1:3], mode="bilinear"
    )
    return (full + change.movedim(1, -1)).clamp(0, 1)


def test_a_picture_of_full_size_is_the_edit():
    full, edited = noise(), noise().flip(-1)
    assert carry_change(edited, full, full) is edited


@pytest.mark.parametrize("tint", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.2)])
def test_a_tint_for_all_is_carried_to_every_pixel_and_none_changes_nothing(tint):
    full = noise()
    for size in SIZES:
        small = shrink(full, *size)
        carried = carry_change(small + torch.tensor(tint), small, full)
        assert_near(carried, full + torch.tensor(tint), ROUNDING)


def test_an_affine_map_of_colors_comes_near_the_truth():
    full = shrink(noise(), 45, 35).repeat_interleave(2, 1).repeat_interleave(2, 2)
    matrix = torch.tensor([[0.1, 0.7, 0.0], [0.6, 0.0, 0.1], [0.0, 0.2, 0.3]])
    small = shrink(full, 30, 20)
    carried = carry_change(small @ matrix, small, full)
    truth = full @ matrix
    assert psnr(carried, truth) > psnr(interpolated(small @ matrix, small, full), truth) + 4


def test_a_new_color_of_the_subject_ends_at_its_edge():
    before, after = (disc(color, (0.3, 0.4, 0.2)) for color in ((0.6, 0.6, 0.65), (0.7, 0.4, 0.1)))
    for size in SIZES:
        small, edited = shrink(before, *size), shrink(after, *size)
        carried = carry_change(edited, small, before)
        assert psnr(carried, after) > psnr(interpolated(edited, small, before), after) + 3
