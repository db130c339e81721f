"""A view as files: the picture and its depth, whole, and never over what is there."""

import numpy as np
import pytest
import torch
from PIL import Image

from gsedit import write_view
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.errors import UsageError
from rasterizer import render


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 500, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def camera():
    return ring_cameras(demo_scene(), 1, 32)[0]


def test_a_picture_is_the_render_in_eight_bits(scene, camera, tmp_path):
    assert write_view(scene, camera, tmp_path / "a") == [tmp_path / "a.png"]
    expected = render(scene, camera).color.clamp(0, 1) * 255
    levels = torch.from_numpy(np.asarray(Image.open(tmp_path / "a.png")).astype(np.float32))
    assert (levels - expected).abs().max() <= 0.5 + 1e-3


def test_depth_is_numbers_and_a_picture(scene, camera, tmp_path):
    paths = write_view(scene, camera, tmp_path / "b.0", show=("color", "depth"))
    assert [path.name for path in paths] == ["b.0.png", "b.0.depth.npy", "b.0.depth.png"]
    depth = np.load(paths[1])
    assert depth.dtype == np.float32
    expected = render(scene, camera, median_depth=True).median_depth
    assert expected is not None
    np.testing.assert_allclose(depth, expected.numpy(), rtol=1e-6)


def test_an_existing_file_is_replaced_only_if_asked(scene, camera, tmp_path):
    (tmp_path / "a.png").write_text("mine")
    with pytest.raises(UsageError, match=r"a\.png"):
        write_view(scene, camera, tmp_path / "a")
    assert (tmp_path / "a.png").read_text() == "mine"
    write_view(scene, camera, tmp_path / "a", overwrite=True)
    assert Image.open(tmp_path / "a.png").size == (32, 32)
