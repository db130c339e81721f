"""Every target is measured; the table shows those that are missed or not measured."""

from __future__ import annotations

from dataclasses import replace
from math import isqrt

import pytest
import torch
from benchmarks import SameProcess, garden_points

from gsedit.bench import measure
from gsedit.bench.renderer import pairs, speed, targets, workloads
from gsedit.bench.renderer.targets import Target
from gsedit.reports.events import Event
from rasterizer.tiles import TILE_SIZES


@pytest.fixture
def points(tmp_path):
    return garden_points(tmp_path / "garden.npz")


@pytest.fixture
def tiny() -> workloads.Workload:
    return workloads.cloud(60, 24, 16)


def test_every_target_is_measured(points, tmp_path, monkeypatch):
    cage = workloads.cloud(80, 32, 24)
    monkeypatch.setattr(targets, "synthetic", lambda: [replace(cage, name="cage")])
    monkeypatch.setattr(targets, "Worker", SameProcess)
    monkeypatch.setattr(speed, "TRAINED", 200)
    monkeypatch.setattr(speed, "SIDE", 64)
    monkeypatch.setattr(speed, "CROP", 32)
    size = targets.Size(runs=1, pieces=1, clouds=(100, 400))
    items = list(targets.measure_targets(size, points, [], tmp_path / "references"))
    events = [item for item in items if isinstance(item, Event)]
    measured = [item for item in items if isinstance(item, Target)]
    assert events[-1].step == events[-1].steps > 0
    names = " ".join(target.name for target in measured)
    for part in ("training step, torch", "crop, torch", "no early stop: mean",
                 "default stop: gradients", "cage: tile choice", "quarters as crops", "2 threads",
                 "memory above the inputs", "time by pairs", "memory by pairs"):  # fmt: skip
        assert part in names
    by_name = {target.name: target for target in measured}
    for scale in (1, 0.25):
        label = f"garden x{scale}, torch, no early stop"
        assert by_name[f"{label}: mean error"].reached
        assert by_name[f"{label}: 99.9 %"].reached
        assert by_name[f"{label}: gradients"].reached
    assert targets.table(measured).count("\n| ") == len(measured) + 2  # head and rule


def test_without_its_points_the_garden_is_left_out_with_a_note(monkeypatch):
    monkeypatch.setattr(targets, "synthetic", list)
    monkeypatch.setattr(targets, "scaling_targets", lambda _: [])
    monkeypatch.setattr(targets, "measure_speed", lambda *_: [])
    events = list(targets.measure_targets(targets.QUICK, None, []))
    assert "not given" in events[0].note
    assert not any(isinstance(item, Target) for item in events)


@pytest.mark.parametrize(("chosen", "reached"), [(1.05, True), (1.3, False)])
def test_a_target_is_missed_where_another_tile_is_faster(tiny, monkeypatch, chosen, reached):
    pairs_, pixels = pairs.listed_pairs(tiny.scene, tiny.camera)
    side = isqrt(pixels // pairs_)
    other = max(set(TILE_SIZES) - {side})
    seconds = dict.fromkeys(TILE_SIZES, 2.0) | {other: 1.0, side: chosen}
    timings = {name: measure.Timing(s, s, 5, 0.015) for name, s in seconds.items()}
    monkeypatch.setattr(targets, "timed_together", lambda *_, **__: (timings, {}))
    (target,) = targets.tile_targets(tiny, targets.QUICK)
    assert target.reached is reached
    assert target.measured.startswith(f"{side}: {chosen:.2f} of {other} ")


def test_the_number_of_threads_is_restored(tiny, monkeypatch):
    before = torch.get_num_threads()
    monkeypatch.setattr(targets, "differentiate", lambda *_: None)
    monkeypatch.setattr(targets.os, "cpu_count", lambda: 2)
    targets.thread_targets(tiny, targets.Size(runs=1, pieces=1))
    assert torch.get_num_threads() == before
    monkeypatch.setattr(targets.os, "cpu_count", lambda: 1)
    (alone,) = targets.thread_targets(tiny, targets.QUICK)
    assert alone.reached is None


def test_a_slope_above_one_is_not_linear():
    line = [(x, 2.0 * x) for x in (1.0, 10.0, 100.0)]
    square = [(x, x * x) for x in (1.0, 10.0, 100.0)]
    assert targets.slope_target("time", line, "").reached is True
    assert targets.slope_target("time", square, "").reached is False
    assert targets.slope_target("time", [], "no peak").reached is None


def test_the_table_shows_what_is_missed_and_not_measured():
    measured = [
        Target("fast", "8 Y wall", "9.1 Y wall", False),
        Target("right", "1e-06", "8e-08", True),
        Target("lean", "2.5 GB", "no peak", None),
    ]
    text = targets.table(measured)
    assert text.startswith("1 of 2 targets are reached on ")
    assert "| fast | 8 Y wall | 9.1 Y wall | **no** |" in text
    assert "| lean | 2.5 GB | no peak | not measured |" in text


@pytest.mark.parametrize(
    ("wall", "cpu", "reached"), [(16, 8, True), (15.9, 9, False), (20, 7, False)]
)
def test_a_speed_is_reached_in_wall_clock_and_in_processor_time(wall, cpu, reached):
    goal = speed.Goal(16, 8)
    row = speed.Speed("garden", "compiled", "peer", 0.1, float(wall), float(cpu), goal, 0.0, None)
    assert row.reached is reached


def test_a_peer_that_is_there_is_what_the_kernels_are_compared_with(tiny, monkeypatch):
    case = speed._case("crop", tiny, 1, box=(4, 4, 8, 8))
    peer = replace(speed.PEER_TABLE["gsplat"], prepare=lambda _: speed.reference_drawing)
    monkeypatch.setattr(speed, "installed", lambda: ([replace(peer, name=speed.PEER)], []))
    monkeypatch.setitem(speed.PEER_TABLE, speed.PEER, peer)
    rows = list(speed._measured(case, 1, None))
    assert {row.other for row in rows} == {speed.PEER}
    assert rows[-1].kernel == "torch"
    for row in rows:  # the crop is the picture that other renderers draw
        assert row.error < 1e-6
        assert row.gradient < 1e-4
