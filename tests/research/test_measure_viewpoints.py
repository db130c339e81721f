"""The measure of found views: what a camera sees itself it has seen, a wall's other side not."""

from __future__ import annotations

import torch
from research.measure_viewpoints import depth_of, seen_share

from rasterizer import Gaussians, look_at


def test_a_wall_is_seen_from_one_side():
    line = torch.linspace(-3, 3, 30)
    means = torch.cartesian_prod(line, line, torch.zeros(1))
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(len(means), 1)
    scales = torch.tensor([0.2, 0.2, 0.02]).log().repeat(len(means), 1)
    wall = Gaussians(means, quats, scales, torch.full((len(means),), 5.0), torch.zeros(900, 1, 3))
    up, middle = torch.tensor([0.0, 1, 0]), torch.zeros(3)
    views = {
        name: look_at(torch.tensor(eye), middle, up, 50.0, 24, 24)
        for name, eye in {
            "front": (0.0, 0, 3), "beside": (0.5, 0, 3), "back": (0.0, 0, -3), "near": (0.0, 0, 1)
        }.items()
    }  # fmt: skip
    real = [(views["front"], depth_of(wall, views["front"]))]
    assert seen_share(wall, views["front"], real) == 1
    assert 0.8 < seen_share(wall, views["beside"], real) < 1
    assert seen_share(wall, views["back"], real) == 0
    assert seen_share(wall, views["near"], real) < 0.5  # finer than the camera saw it
