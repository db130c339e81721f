"""The part of a scene that its cameras stand around."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from splat_tables import random_table

from gsedit import View
from gsedit.datasets.cameras_json import write_cameras
from gsedit.errors import UsageError
from gsedit.select.rules import middle
from gsedit.toolkit import filter, select
from rasterizer import Camera, look_at

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


def test_cameras_that_look_in_parallel_have_no_middle(tmp_path):
    parallel = [
        look_at(torch.tensor([x, 0.0, 0.0]), torch.tensor([x, 0.0, 9.0]),
                torch.tensor([0.0, -1.0, 0.0]), 1.0, 32, 32)
        for x in (0.0, 1.0, 2.0)
    ]  # fmt: skip
    path, picture = tmp_path / "cameras.json", torch.zeros(32, 32, 3)
    write_cameras([View(str(i), c, picture) for i, c in enumerate(parallel)], path)
    with pytest.raises(UsageError, match="no common point"):
        select(random_table(5), middle(0.5, str(path)))


def test_what_is_near_that_point_stays(cameras):
    table = random_table(500)
    away = np.linalg.norm(table.means - MIDDLE.numpy(), axis=1)
    kept = filter(table, middle(0.5, str(cameras)))
    near = away <= 0.5 * 4 * np.sqrt(1.16)
    assert 0 < near.sum() < 500
    np.testing.assert_array_equal(kept.means, table.means[near])


def test_an_expression_names_it_by_its_cameras(cameras):
    table = random_table(500)
    named = select(table, f"not middle(0.5, '{cameras}')")
    np.testing.assert_array_equal(named, ~select(table, middle(0.5, str(cameras))))


def test_a_share_must_be_above_zero(cameras):
    with pytest.raises(UsageError, match="above 0"):
        middle(0.0, str(cameras))
