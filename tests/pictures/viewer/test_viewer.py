"""Viewers show what is there, and say what to install where a library is missing."""

import sys

import numpy as np
import pytest
import torch
from point_clouds import cloud

from gsedit.errors import GseditError
from gsedit.formats.scenes import load
from gsedit.pictures.viewer import drawing, point_clouds
from gsedit.pictures.viewer.drawing import Look, Panel
from rasterizer import Camera


def test_pyvista_points_are_where_the_camera_says():
    pytest.importorskip("pyvista", exc_type=ImportError)
    height, width = 48, 64
    pose = torch.eye(4, dtype=torch.float64)
    pose[2, 3] = 4
    camera = Camera(pose, 60.0, 60.0, 20.0, 30.0, width, height)  # principal point off center
    scene = cloud(torch.tensor([[0.4, -0.6, 0.2]]), color=(1.0, 0.0, 0.0))
    try:
        picture = np.asarray(drawing.draw([Panel(scene)], camera, Look(point_size=3.0))).astype(int)
    except GseditError as error:
        pytest.skip(f"no OpenGL here: {error}")
    y, x = np.nonzero(picture[..., 0] - picture[..., 1] > 128)
    expected = camera.project(scene.means.double())[0][0]
    # half a pixel of rasterisation; a point is 3 pixels wide
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - expected.numpy()).max() < 1


@pytest.mark.parametrize("degree", [0, 1])
def test_open3d_writes_the_same_scene(tmp_path, degree):
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    generator = torch.Generator().manual_seed(1)
    scene = cloud(torch.randn(6, 3, generator=generator), degree=degree)
    scene = scene.map(lambda field: field + 0.1 * torch.rand(field.shape, generator=generator))
    open3d.t.io.write_point_cloud(str(tmp_path / "o.ply"), point_clouds.to_open3d(scene))
    back = load(tmp_path / "o.ply")
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
        # scales go through exp and log: a few float32 roundings
        assert torch.allclose(getattr(back, name), getattr(scene, name), atol=1e-6), name


@pytest.mark.parametrize("view", [point_clouds.to_open3d, point_clouds.to_pyvista])
def test_missing_viewers_are_one_line_with_the_next_move(view, monkeypatch):
    for name in ("open3d", "pyvista", "vtk"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(GseditError, match="pip install") as error:
        view(cloud(torch.zeros(1, 3)))
    assert "\n" not in str(error.value)
