"""Depth pictures: the colors say near and far, and only of surfaces."""

from __future__ import annotations

import numpy as np
import torch

from gsedit.pictures.depth_pictures import LEGEND, depth_picture, depth_range


def test_depth_range_ignores_what_is_not_solid():
    depth = torch.linspace(2, 4, 101)[None].repeat(3, 1)
    alpha = torch.ones_like(depth)
    depth[0], alpha[0] = 1000.0, 0.1
    near, far = depth_range(depth, alpha)
    assert 2 <= near < 2.1
    assert 3.9 < far <= 4
    assert depth_range(depth, torch.zeros_like(alpha)) == (0.0, 1.0)
    flat = depth_range(torch.full((2, 2), 3.0), torch.ones(2, 2))
    assert flat[0] == 3.0 < flat[1]


def test_depth_picture_is_red_near_blue_far_black_where_nothing_is():
    depth = torch.linspace(1, 3, 64)[None].repeat(8, 1)
    alpha = torch.ones_like(depth)
    alpha[:2] = 0
    picture = np.asarray(depth_picture(depth, alpha)).astype(int)
    assert picture.shape == (8 + LEGEND, 64, 3)
    assert (picture[:2] == 0).all()
    near, far = picture[5, 2], picture[5, -3]
    assert near[0] > near[2]  # red
    assert far[2] > far[0]  # blue
