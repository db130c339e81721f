"""Noise levels of the schedules that are not Stable Diffusion's."""

import math

import pytest
import torch

from gsedit.diffusion.predictions import as_pair
from gsedit.diffusion.schedules import CLEAN, Schedule


def test_a_rectified_flow_reads_a_thousand_times_its_share_of_noise():
    level = Schedule.rectified_flow().level_at(1.0)
    assert (level.t, level.a, level.b) == pytest.approx((500, 0.5, 0.5))


def test_edm_reads_a_quarter_of_the_logarithm_of_sigma():
    schedule = Schedule.edm(0.002, 120.0)
    first, *_, last, end = schedule.levels(10, spacing="karras")
    assert (first.sigma, last.sigma) == pytest.approx((120, 0.002))
    assert (first.t, last.t) == pytest.approx((math.log(120) / 4, math.log(0.002) / 4))
    assert end == CLEAN


def test_edm_v_is_the_velocity_of_the_unit_circle():
    # Karras et al. 2022, table 1, with sigma_data 1; x is not scaled there
    level = Schedule.edm(0.002, 120.0).level_at(3.0)
    scaled, network = torch.randn(
        2, 1, 4, 2, 2, generator=torch.Generator().manual_seed(0)
    ).unbind()
    unscaled = scaled / level.a
    expected = unscaled / 10 - 3 / 10**0.5 * network
    torch.testing.assert_close(as_pair("v", network, scaled, level).x0, expected)
