"""The colors of a picture: nearer by sliced distance, the same each time, on a selection."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from kornia.color import lab_to_rgb, rgb_to_lab
from PIL import Image

from gsedit.scene.color_space import lab_of_srgb, srgb_of_lab
from gsedit.scene.table import SplatTable
from gsedit.toolkit import Palette, apply
from gsedit.toolkit.recolor import color_transport, read_colors, sliced_distance


def test_lab_is_kornias_and_goes_back():
    colors = np.random.default_rng(0).uniform(0, 1, (200, 3))
    as_image = torch.from_numpy(colors).T[None, :, None]
    np.testing.assert_allclose(
        lab_of_srgb(colors), rgb_to_lab(as_image)[0, :, 0].T.numpy(), atol=0.02
    )
    np.testing.assert_allclose(srgb_of_lab(lab_of_srgb(colors)), colors, atol=1e-9)
    outside = np.array([[-0.2, 0.5, 1.4], [1.2, -0.1, 0.0]])
    np.testing.assert_allclose(srgb_of_lab(lab_of_srgb(outside)), outside, atol=1e-9)
    assert lab_to_rgb(torch.zeros(1, 3, 1, 1)).abs().max() < 1e-3


@pytest.fixture
def painting(tmp_path):
    """Blue and yellow in unequal shares, with grain."""
    draw = np.random.default_rng(3)
    yellow = draw.random((40, 50, 1)) < 0.3
    colors = np.where(yellow, (0.9, 0.8, 0.2), (0.1, 0.2, 0.6)) + 0.05 * draw.normal(
        size=(40, 50, 3)
    )
    path = tmp_path / "painting.png"
    Image.fromarray((np.clip(colors, 0, 1) * 255).astype(np.uint8)).save(path)
    return path


def grey_table(n: int = 400) -> SplatTable:
    draw = np.random.default_rng(2)
    sh = np.zeros((n, 4, 3))
    sh[:, 0] = 0.6 * draw.normal(size=(n, 1)) + 0.4 * draw.normal(size=(n, 3))
    sh[:, 1:] = 0.005 * draw.normal(size=(n, 3, 3))
    fields = (draw.normal(size=(n, 3)), draw.normal(size=(n, 4)), np.zeros((n, 3)), np.zeros(n), sh)
    return SplatTable(*(np.asarray(each, np.float32) for each in fields))


def test_colors_come_near_those_of_the_picture(painting):
    table, goal = grey_table(), read_colors(painting)
    even = np.ones(len(table))
    before = sliced_distance(table.colors, even, goal)
    after = apply(table, Palette(painting))
    half = apply(table, Palette(painting, 0.5))
    assert sliced_distance(after.colors, even, goal) < 0.25 * before
    assert sliced_distance(after.colors, even, goal) < sliced_distance(half.colors, even, goal)
    assert sliced_distance(half.colors, even, goal) < before
    np.testing.assert_array_equal(apply(table, Palette(painting)).sh, after.sh)
    np.testing.assert_array_equal(after.means, table.means)


def test_a_set_of_colors_is_at_distance_0_of_itself_and_stays():
    colors = np.random.default_rng(4).uniform(0.2, 0.8, (500, 3))
    even = np.ones(500)
    assert sliced_distance(colors, even, colors) == pytest.approx(0, abs=1e-9)
    moved = color_transport(colors, even, colors)(colors)
    np.testing.assert_allclose(moved, colors, atol=1e-6)
