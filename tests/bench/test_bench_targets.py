"""Every target is measured; the table shows those that are missed or not measured."""

from __future__ import annotations

import pytest
import torch
from benchmarks import cloud, garden_points

from gsedit import Event
from gsedit.bench.renderer import speed, targets
from gsedit.bench.renderer.targets import Target


@pytest.fixture
def points(tmp_path):
    return garden_points(tmp_path / "garden.npz")


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_every_target_is_measured(points, tmp_path, monkeypatch):
    training = speed.TrainingStep(200, 64, 32)
    size = targets.Size(runs=1, pieces=1, training=training)
    items = list(targets.measure_targets(size, points, tmp_path / "references"))
    events = [item for item in items if isinstance(item, Event)]
    measured = [item for item in items if isinstance(item, Target)]
    assert events[-1].step == events[-1].steps > 0
    names = " ".join(target.name for target in measured)
    for part in ("training step, torch", "crop, torch", "no early stop: mean",
                 "default stop: gradients", "2 threads"):  # fmt: skip
        assert part in names
    by_name = {target.name: target for target in measured}
    for scale in (1, 0.25):
        label = f"garden x{scale}, torch, no early stop"
        assert by_name[f"{label}: mean error"].reached
        assert by_name[f"{label}: 99.9 %"].reached
        assert by_name[f"{label}: gradients"].reached
    assert targets.table(measured).count("\n| ") == len(measured) + 2  # head and rule


def test_without_its_points_the_garden_is_left_out_with_a_note(monkeypatch):
    monkeypatch.setattr(targets, "measure_speed", lambda *_: [])
    events = list(targets.measure_targets(targets.QUICK, None))
    assert "not given" in events[0].note
    assert not any(isinstance(item, Target) for item in events)


def test_the_number_of_threads_is_restored(tiny, monkeypatch):
    before = torch.get_num_threads()
    monkeypatch.setattr(targets, "differentiate", lambda *_: None)
    monkeypatch.setattr(targets.os, "cpu_count", lambda: 2)
    targets.thread_targets(tiny, targets.Size(runs=1, pieces=1))
    assert torch.get_num_threads() == before
    monkeypatch.setattr(targets.os, "cpu_count", lambda: 1)
    (alone,) = targets.thread_targets(tiny, targets.QUICK)
    assert alone.reached is None


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


def test_a_rival_is_what_the_kernels_are_compared_with(tiny):
    case = speed._case("crop", tiny, 1, box=(4, 4, 8, 8))
    rival = speed.Rival("other", lambda _: speed.reference_drawing, {})
    rows = list(speed.measure_case(case, 1, None, rival))
    assert {row.other for row in rows} == {"other"}
    assert rows[-1].kernel == "torch"
    for row in rows:  # the crop is the picture that other renderers draw
        assert row.error < 1e-6
        assert row.gradient < 1e-4
