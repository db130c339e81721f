"""Counts of pairs, and the alphas near the floor."""

from __future__ import annotations

from dataclasses import replace

import pytest
from research.renderer import pairs
from research.renderer.workloads import cloud

from gsedit.bench.renderer import speed
from rasterizer.numerics import AUTO


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_smaller_tiles_evaluate_fewer_pixels_in_more_pairs(tiny):
    few, many = (
        pairs.listed_pairs(tiny.scene, tiny.camera, execution=replace(AUTO, tile_size=side))
        for side in (4, 16)
    )
    assert few[1] == 16 * few[0]
    assert many[1] == 256 * many[0]
    assert few[0] > many[0]
    assert few[1] < many[1]


def test_an_empty_scene_has_no_pairs(tiny):
    nothing = tiny.scene[:0]
    assert pairs.listed_pairs(nothing, tiny.camera) == (0, 0)
