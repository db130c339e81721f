"""What the cameras stand around: the point they look at, and what is near it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from splat_tables import random_table

from gsedit.errors import UsageError
from gsedit.files.cameras import write_cameras
from gsedit.files.streams import SceneHeader, gather, in_blocks
from gsedit.points import where
from gsedit.points.background import InTheMiddle, RemoveBackground, looked_at, remove_background
from gsedit.points.operation import run
from gsedit.views.dataset import View
from rasterizer.camera import Camera, look_at

MIDDLE = torch.tensor([1.0, -2.0, 0.5])


def ring(count: int = 8, radius: float = 4.0) -> list[Camera]:
    """Cameras on a circle, which look at MIDDLE."""
    up = torch.tensor([0.0, -1.0, 0.0])
    angles = torch.arange(count) * 2 * torch.pi / count
    eyes = [MIDDLE + radius * torch.tensor([a.cos(), -0.4, a.sin()]) for a in angles]
    return [look_at(eye, MIDDLE, up, 1.0, 32, 32) for eye in eyes]


@pytest.fixture
def cameras(tmp_path):
    path = tmp_path / "cameras.json"
    picture = torch.zeros(32, 32, 3)
    write_cameras([View(str(i), c, picture) for i, c in enumerate(ring())], path)
    return path


def test_the_point_that_cameras_look_at_is_found():
    middle, distance = looked_at(ring())
    np.testing.assert_allclose(middle, MIDDLE.numpy(), atol=1e-5)
    assert distance == pytest.approx(4 * np.sqrt(1.16), rel=1e-5)
    parallel = [
        look_at(torch.tensor([x, 0.0, 0.0]), torch.tensor([x, 0.0, 9.0]),
                torch.tensor([0.0, -1.0, 0.0]), 1.0, 32, 32)
        for x in (0.0, 1.0, 2.0)
    ]  # fmt: skip
    with pytest.raises(UsageError, match="in parallel"):
        looked_at(parallel)


def test_what_is_near_that_point_stays(cameras):
    table = random_table(500)
    away = np.linalg.norm(table.means - MIDDLE.numpy(), axis=1)
    kept = remove_background(table, InTheMiddle(cameras, 0.5))
    near = away <= 0.5 * 4 * np.sqrt(1.16)
    assert 0 < near.sum() < 500
    np.testing.assert_array_equal(kept.means, table.means[near])


def test_parts_of_a_scene_may_be_all_background_or_all_subject():
    table = random_table(100)
    table = table[np.argsort(table.means[:, 0])]
    header = SceneHeader(table.degree)
    keep = RemoveBackground(selection=where("largest(50, x)"))
    _, blocks, _ = run(header, in_blocks(table, 10), [keep])
    np.testing.assert_array_equal(gather(blocks, header, 50).means, table.means[50:])


def test_all_and_nothing_are_refused(cameras):
    table = random_table(50)
    for within, message in ((1e-6, "no subject"), (1e6, "no background")):
        with pytest.raises(UsageError, match=message):
            remove_background(table, InTheMiddle(cameras, within))
    with pytest.raises(UsageError, match="above 0"):
        InTheMiddle(cameras, 0.0)
