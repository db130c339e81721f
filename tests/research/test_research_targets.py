"""The renderer's further targets are measured, and missed where they should be."""

from __future__ import annotations

from dataclasses import replace
from math import isqrt

import pytest
from benchmarks import SameProcess, garden_points
from research.renderer import pairs, targets
from research.renderer.sharing import FitSize, Sharing, count_steps
from research.renderer.workloads import cloud

from gsedit.bench import measure
from gsedit.bench.renderer.speed import Workload
from gsedit.bench.renderer.targets import QUICK, Size, Target
from rasterizer.tiles import TILE_SIZES


@pytest.fixture
def tiny() -> Workload:
    return cloud(60, 24, 16)


def test_every_target_is_measured(tmp_path, monkeypatch):
    points, cage = garden_points(tmp_path / "garden.npz"), cloud(80, 32, 24)
    monkeypatch.setattr(targets, "synthetic", lambda: [replace(cage, name="cage")])
    monkeypatch.setattr(targets, "Worker", SameProcess)
    monkeypatch.setattr(targets, "measure_sharing", lambda *_: Sharing(1.0, 0.9, 0.5))
    extent = targets.Extent(Size(runs=1, pieces=1), clouds=(100, 400))
    items = targets.measure_further(extent, points, [], tmp_path / "references")
    names = " ".join(item.name for item in items if isinstance(item, Target))
    for part in ("away from the floor", "cage: tile choice", "quarters as crops", "busy loop",
                 "memory above the inputs", "time by pairs", "memory by pairs",
                 "two fits at once"):  # fmt: skip
        assert part in names


def test_steps_of_a_fit_are_counted():
    small = FitSize(200, 3, 16, 1)
    assert count_steps("auto", 0.0, small) == 0
    assert count_steps("auto", 0.1, small) > 0


def test_targets_beside_other_programs(monkeypatch):
    monkeypatch.setattr(targets, "measure_sharing", lambda *_: Sharing(1.04, 0.9, 0.5))
    rows = targets.sharing_targets(targets.SHORT)
    assert [row.reached for row in rows[:3]] == [True, True, False]


@pytest.mark.parametrize(("chosen", "reached"), [(1.05, True), (1.3, False)])
def test_a_target_is_missed_where_another_tile_is_faster(tiny, monkeypatch, chosen, reached):
    pairs_, pixels = pairs.listed_pairs(tiny.scene, tiny.camera)
    side = isqrt(pixels // pairs_)
    other = max(set(TILE_SIZES) - {side})
    seconds = dict.fromkeys(TILE_SIZES, 2.0) | {other: 1.0, side: chosen}
    timings = {name: measure.Timing(s, s, 5, 0.015) for name, s in seconds.items()}
    monkeypatch.setattr(targets, "timed_together", lambda *_, **__: (timings, {}))
    (target,) = targets.tile_targets(tiny, QUICK)
    assert target.reached is reached
    assert target.measured.startswith(f"{side}: {chosen:.2f} of {other} ")


def test_a_slope_above_one_is_not_linear():
    line = [(x, 2.0 * x) for x in (1.0, 10.0, 100.0)]
    square = [(x, x * x) for x in (1.0, 10.0, 100.0)]
    assert targets.slope_target("time", line, "").reached is True
    assert targets.slope_target("time", square, "").reached is False
    assert targets.slope_target("time", [], "no peak").reached is None
