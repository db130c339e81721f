"""Open3D's own pictures: points where there is no Vulkan, splats where there is."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from command_line import gsedit, one_line
from PIL import Image
from point_clouds import ball, cloud

from gsedit.errors import UsageError
from gsedit.formats.scenes import save
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


def test_splats_beside_the_camera_are_left_out():
    scene = cloud(torch.tensor([[0.0, 0, 3], [0, 0, -1], [1.5, 0, 1], [9.0, 0, 1], [9.0, 0, 30]]))
    kept = open3d_drawing.in_reach(scene, ahead())
    # 1.5 right at depth 1 is at pixel 110 of 64: 2.4 half pictures from the middle
    assert kept.tolist() == [True, False, False, False, True]


def test_where_vulkan_fails_points_are_drawn_and_the_package_is_named(
    open3d, tmp_path, monkeypatch
):
    failed = open3d_drawing.draw_splats(ball(), ahead(), program="import os; os.abort()")
    assert failed is None
    monkeypatch.setattr(open3d_drawing, "draw_splats", lambda *_: failed)
    save(ball(), tmp_path / "a.ply")
    out = tmp_path / "a.png"
    words = ("--open3d", "--width", 64, "--height", 48, "--json")
    result = gsedit("view", tmp_path / "a.ply", "-o", out, *words)
    assert result.exit_code == 0, result.stderr
    assert "apt-get install -y libvulkan1 mesa-vulkan-drivers" in result.stderr
    assert json.loads(result.stdout)["picture"] == str(out)
    assert (np.asarray(Image.open(out)) < 200).any()
    with pytest.raises(UsageError, match="lower min_opacity"):
        open3d_drawing.preview_open3d(ball(), tmp_path / "b.png", min_opacity=0.999)


def test_splats_are_drawn_where_there_is_vulkan(open3d):
    drawn = open3d_drawing.draw_splats(cloud(torch.tensor([[0.0, 0.0, 2.0]])), ahead())
    if drawn is None:
        pytest.skip("no Vulkan here")
    picture = np.asarray(drawn[0]).astype(int)
    y, x = np.nonzero(picture[..., 0] - picture[..., 1] > 60)
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - [20, 30]).max() < 1


@pytest.mark.parametrize("words", [["--color-by", "size"], ["--cameras"], ["b.ply"]], ids=" ".join)
def test_what_open3d_does_not_draw_is_refused(words, tmp_path):
    result = gsedit("view", tmp_path / "a.ply", *words, "--open3d", "-o", tmp_path / "a.png")
    assert result.exit_code == 2
    assert "--open3d draws one scene in its colors: leave out" in result.stderr
    assert one_line(result.stderr)
