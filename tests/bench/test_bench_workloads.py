"""The garden is made of its points."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks import garden_points

from gsedit.bench.renderer import speed
from gsedit.errors import InputError
from rasterizer import render


@pytest.fixture
def points(tmp_path):
    return garden_points(tmp_path / "garden.npz")


def test_the_garden_is_made_of_its_points(points):
    with np.load(points) as file:
        means = file["means3d"]
    kept = (np.abs(means) <= 2).all(1)
    one = speed.garden(0.5, points, view=2)
    assert one.name == "garden x0.5, view 2"
    assert (one.camera.width, one.camera.height, one.camera.fx) == (32, 24, 30.0)
    assert np.allclose(one.scene.means, means[kept], atol=1e-6)  # float32
    assert one.scene.scales.min() >= 0.99e-4
    assert one.scene.scales.max() <= 0.0201
    assert 0.2 < render(one.scene, one.camera).alpha.max() <= 1


@pytest.mark.parametrize("content", [b"", b"PK nonsense", None], ids=["empty", "broken", "absent"])
def test_points_that_are_none_are_an_input_error(tmp_path, content):
    path = tmp_path / "garden.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="not the garden's points"):
        speed.garden(1.0, path)


def test_points_without_cameras_are_an_input_error(tmp_path):
    np.savez(tmp_path / "garden.npz", means3d=np.zeros((2, 3)), colors=np.zeros((2, 3)))
    with pytest.raises(InputError, match="Ks"):
        speed.garden(1.0, tmp_path / "garden.npz")
