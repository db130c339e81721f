"""The renderer's further targets are measured, and missed where they should be."""

from __future__ import annotations

from dataclasses import replace
from math import isqrt

import pytest
from benchmarks import SameProcess, garden_points
from research.renderer import pairs, targets
from research.renderer.workloads import cloud

from gsedit.bench.renderer.speed import Workload
from rasterizer.tiles import TILE_SIZES


@pytest.fixture
def tiny() -> Workload:
    return cloud(60, 24, 16)


def test_every_target_is_measured(tmp_path, monkeypatch):
    points, cage = garden_points(tmp_path / "garden.npz"), cloud(80, 32, 24)
    monkeypatch.setattr(targets, "synthetic", lambda: [replace(cage, name="cage")])
    monkeypatch.setattr(targets, "Worker", SameProcess)
    extent = targets.Extent(runs=1, clouds=(100, 400))
    items = targets.measure_further(extent, points, [])
    names = " ".join(item.name for item in items if isinstance(item, targets.Target))
    for part in ("cage: tile choice", "quarters as crops", "memory above the inputs",
                 "time by pairs", "memory by pairs"):  # fmt: skip
        assert part in names


@pytest.mark.parametrize(("chosen", "reached"), [(1.05, True), (1.3, False)])
def test_a_target_is_missed_where_another_tile_is_faster(tiny, monkeypatch, chosen, reached):
    pairs_, pixels = pairs.listed_pairs(tiny.scene, tiny.camera)
    side = isqrt(pixels // pairs_)
    other = max(set(TILE_SIZES) - {side})
    seconds = dict.fromkeys(TILE_SIZES, 2.0) | {other: 1.0, side: chosen}
    timings = {name: targets.Timing(s, s, 5) for name, s in seconds.items()}
    monkeypatch.setattr(targets, "timed_together", lambda *_, **__: (timings, {}))
    (target,) = targets.tile_targets(tiny, 1)
    assert target.reached is reached
    assert target.measured.startswith(f"{side}: {chosen:.2f} of {other} ")


def test_a_slope_above_one_is_not_linear():
    line = [(x, 2.0 * x) for x in (1.0, 10.0, 100.0)]
    square = [(x, x * x) for x in (1.0, 10.0, 100.0)]
    assert targets.slope_target("time", line, "").reached is True
    assert targets.slope_target("time", square, "").reached is False
    assert targets.slope_target("time", [], "no peak").reached is None
