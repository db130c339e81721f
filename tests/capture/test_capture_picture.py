"""The picture of cameras and points."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from PIL import Image

from gsedit.capture.picture import SIZE_PIXELS, save_picture
from gsedit.errors import UsageError
from rasterizer import look_at


def orbit(count: int):
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    eyes = [torch.tensor([2 * np.sin(a), -0.8, 2 * np.cos(a)]) for a in angles]
    down = torch.tensor([0.0, -1.0, 0.0])
    return [look_at(eye, torch.zeros(3), down, 50.0, 64, 48) for eye in eyes]


def test_cameras_and_points_are_drawn_and_never_over_another_file(tmp_path):
    points = np.random.default_rng(0).normal(size=(500, 3)) * 0.3
    colors = np.tile([1.0, 0.0, 0.0], (500, 1))
    path = tmp_path / "cameras.png"
    save_picture(points, colors, orbit(12), path)
    picture = np.asarray(Image.open(path)).astype(int)
    assert picture.shape == (SIZE_PIXELS[1], 2 * SIZE_PIXELS[0], 3)
    red = (picture[..., 0] > 200) & (picture[..., 1] < 80)
    halves = red[:, : SIZE_PIXELS[0]], red[:, SIZE_PIXELS[0] :]
    assert all(half.sum() > 300 for half in halves)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20  # the colors of twelve pyramids
    with pytest.raises(UsageError, match="already exists"):
        save_picture(points, colors, orbit(12), path)
