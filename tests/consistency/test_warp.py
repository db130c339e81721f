"""A picture seen through another view, by depth."""

from __future__ import annotations

import torch
from walls import (
    FOUR,
    SLANTED,
    occluded_depth,
    plane_depth,
    seen,
)

from gsedit.consistency.warp import warp


def paint(view, depth):
    """Colors by world position, smooth over many pixels."""
    points = view.unproject(view.pixel_centers(), depth)
    return 0.5 + 0.4 * torch.sin(3 * points + torch.tensor([0.0, 1.0, 2.0]))


def test_a_painted_scene_looks_the_same_through_another_view():
    a, b = FOUR[1], FOUR[2]
    wall = [plane_depth(c, SLANTED) for c in (a, b)]
    found, valid = warp(paint(b, wall[1]), *seen(a, wall[0]), *seen(b, wall[1]))
    assert valid.double().mean() > 0.8
    # bilinear in 0.4 sin(3 x) between pixels up to 0.05 apart: 9 x 0.4 x 0.05^2 / 8, in x and y
    assert (found - paint(a, wall[0]))[valid].abs().max() < 2.3e-3
    assert (found[~valid] == 0).all()


def test_what_is_hidden_is_not_warped():
    a, b = FOUR[1], FOUR[2]
    xy = a.pixel_centers()
    true, z = b.project(a.unproject(xy, occluded_depth(a)))
    hidden = z > 1.02 * occluded_depth(b, true)
    views = [*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b))]
    _, valid = warp(torch.ones(128, 128, 3), *views)
    assert hidden.sum() > 100
    assert not valid[hidden].any()


def test_a_surface_at_another_depth_is_not_warped():
    view, depth, alpha = seen(FOUR[0])
    image = torch.ones(128, 128, 3)
    _, valid = warp(image, view, depth, alpha, view, 1.02 * depth, alpha)
    assert not valid.any()  # though from the same camera every pixel returns to itself


def test_warping_into_the_same_view_changes_nothing():
    view = seen(FOUR[0], plane_depth(FOUR[0], SLANTED))
    image = torch.rand(128, 128, 3, generator=torch.Generator().manual_seed(0))
    found, valid = warp(image, *view, *view)
    assert valid.all()
    torch.testing.assert_close(found, image, atol=2e-5, rtol=0)  # 128 px x eps32 in the sample grid
