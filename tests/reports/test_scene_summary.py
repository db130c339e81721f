"""A scene in a few numbers, which stay exact for any number of Gaussians."""

from __future__ import annotations

import pytest
import torch

from gsedit.reports.scene_summary import QUANTILES, quantiles_of, summarise
from rasterizer.scene import Gaussians


def test_quantiles_are_values_of_the_scene():
    values = torch.arange(101.0)[torch.randperm(101, generator=torch.Generator().manual_seed(0))]
    assert quantiles_of(values) == (0.0, 1.0, 50.0, 99.0, 100.0)
    assert quantiles_of(torch.tensor([3.0])) == (3.0,) * len(QUANTILES)


def test_a_summary_has_the_bounds_of_positions_opacities_and_sizes():
    means = torch.tensor([[0.0, 1, 2], [3, -4, 5]])
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(2, 1)
    sizes = torch.tensor([[1.0, 2, 3], [4, 5, 6]])
    logits = torch.tensor([0.0, 2.0])
    scene = Gaussians(means, quats, sizes.log(), logits, torch.zeros(2, 4, 3))
    summary = summarise(scene)
    assert (summary.gaussians, summary.sh_degree, summary.quantiles) == (2, 1, QUANTILES)
    assert [(axis[0], axis[-1]) for axis in (summary.x, summary.y, summary.z)] == [
        (0, 3), (-4, 1), (2, 5),
    ]  # fmt: skip
    assert (summary.opacity[0], summary.opacity[-1]) == pytest.approx((0.5, 0.880797), abs=1e-6)
    assert (summary.scale[0], summary.scale[-1]) == pytest.approx((1, 6), rel=1e-6)
