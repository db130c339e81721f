"""Scenes of many Gaussians for `research.scale`."""

from __future__ import annotations

import pytest
import torch
from research.scale.divide import divide
from research.scale.measure import ScaleMeasurement, table

from gsedit.synthetic import demo_scene, surface_gaussians
from rasterizer.project import rotation_matrices


def covariances(scene):
    axes = rotation_matrices(scene.quats) * scene.scales[:, None, :]
    return axes @ axes.mT


def test_the_parts_of_a_gaussian_have_its_mean_and_covariance():
    random = torch.Generator().manual_seed(0)
    whole = surface_gaussians(demo_scene(), 20, random)
    whole = whole.to(torch.float64)
    fine = divide(whole, 9, 3, random)
    assert fine.sh.shape == (len(whole) * 9, 16, 3)
    assert fine.sh[:, 4:].abs().amax() < 0.05
    assert fine.sh[:, 4:].abs().amin() > 0
    means = fine.means.view(-1, 9, 3)
    torch.testing.assert_close(means.mean(1), whole.means)
    apart = means - means.mean(1, keepdim=True)
    spread = (apart[..., None] * apart[:, :, None]).mean(1)
    total = spread + covariances(fine).view(-1, 9, 3, 3).mean(1)
    torch.testing.assert_close(total, covariances(whole))
    with pytest.raises(ValueError, match="1 or more"):
        divide(whole, 0, 1, random)


def test_the_table_has_a_column_a_stage():
    row = ScaleMeasurement(1_900_000, 3, 91.4, {"survey": 20.4, "total": 90.0}, 2.5, None, 41.0,
                           100.0, 30.25)  # fmt: skip
    head, _, line = table([row]).splitlines()
    assert "survey" in head
    assert "total" not in head
    assert line == "| 1,900,000 | 3 | 91 | 20 | 2.50 | - | 41.00 | - | 30.25 |"
