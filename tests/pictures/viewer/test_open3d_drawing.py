"""Open3D's own pictures: points where there is no Vulkan, splats where there is."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from point_clouds import cloud

from gsedit.pictures.viewer import open3d_drawing
from rasterizer import Camera


@pytest.fixture
def open3d():
    return pytest.importorskip("open3d", exc_type=ImportError)


def ahead() -> Camera:
    pose = torch.eye(4, dtype=torch.float64)
    return Camera(pose, 60.0, 60.0, 20.0, 30.0, 64, 48)


def test_points_are_where_the_camera_says_and_the_rest_is_white(open3d):
    scene = cloud(torch.tensor([[0.4, -0.6, 3.0]]))
    picture = np.asarray(open3d_drawing.draw_points(scene, ahead())).astype(int)
    assert picture.shape == (48, 64, 3)
    y, x = np.nonzero(picture[..., 1] < 128)
    expected = ahead().project(scene.means.double())[0][0].numpy()
    # the point is a square of 8 pixels, on a grid of 8
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - expected).max() <= 4
    assert (picture[0, 0] == 255).all()


def test_splats_are_drawn_where_there_is_vulkan(open3d):
    drawn = open3d_drawing.draw_splats(cloud(torch.tensor([[0.0, 0.0, 2.0]])), ahead())
    if drawn is None:
        pytest.skip("no Vulkan here")
    picture = np.asarray(drawn[0]).astype(int)
    y, x = np.nonzero(picture[..., 0] - picture[..., 1] > 60)
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - [20, 30]).max() < 1
