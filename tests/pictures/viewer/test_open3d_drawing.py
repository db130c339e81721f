"""Open3D's own pictures of splats, where there is Vulkan."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from command_line import gsedit
from point_clouds import ball, cloud

from gsedit.errors import GseditError
from gsedit.formats.scenes import save
from gsedit.pictures.viewer import open3d_drawing
from rasterizer import Camera


@pytest.fixture
def open3d():
    return pytest.importorskip("open3d", exc_type=ImportError)


def ahead() -> Camera:
    pose = torch.eye(4, dtype=torch.float64)
    return Camera(pose, 60.0, 60.0, 20.0, 30.0, 64, 48)


def test_where_vulkan_fails_the_package_is_named(open3d, tmp_path, monkeypatch):
    with pytest.raises(GseditError, match="libvulkan1 mesa-vulkan-drivers"):
        open3d_drawing.draw_splats(ball(), ahead(), program="import os; os.abort()")
    monkeypatch.setattr(open3d_drawing.draw_splats, "__defaults__", ("import os; os.abort()",))
    save(ball(), tmp_path / "a.ply")
    result = gsedit("view", tmp_path / "a.ply", "-o", tmp_path / "a.png", "--open3d")
    assert result.exit_code == 1
    assert "leave out --open3d" in result.stderr


def test_splats_are_drawn_where_there_is_vulkan(open3d):
    try:
        drawn, _ = open3d_drawing.draw_splats(cloud(torch.tensor([[0.0, 0.0, 2.0]])), ahead())
    except GseditError:
        pytest.skip("no Vulkan here")
    picture = np.asarray(drawn).astype(int)
    y, x = np.nonzero(picture[..., 0] - picture[..., 1] > 60)
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - [20, 30]).max() < 1
