"""Speed and errors of the renderer: every case is measured; the garden is made of its points."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from benchmarks import garden_points

from gsedit import Event
from gsedit.bench.renderer import speed
from gsedit.bench.renderer.speed import timed, timed_together
from gsedit.bench.results import commit, machine
from gsedit.errors import InputError
from rasterizer import render


@pytest.fixture
def points(tmp_path):
    return garden_points(tmp_path / "garden.npz")


def test_every_case_is_measured_with_its_errors(points, tmp_path):
    training = speed.TrainingStep(3200, 256, 128)
    items = list(speed.measure_targets(points, quick=True, training=training))
    events = [item for item in items if isinstance(item, Event)]
    rows = [item for item in items if isinstance(item, speed.Speed)]
    assert events[-1].step == events[-1].steps == 4
    assert [row.case for row in rows if row.kernel == "torch"] == [
        "garden 64x48", "garden 16x12", "training step", "crop"
    ]  # fmt: skip
    for row in rows:
        assert row.wall > 0
        assert row.error < 1e-6
        assert row.gradient < 1e-3
    assert speed.table(rows).count("\n| ") == len(rows) + 2  # head and rule


def test_without_its_points_the_garden_is_left_out_with_a_note():
    assert "not given" in next(speed.measure_targets(None)).note


def test_the_table_shows_what_is_missed_and_what_has_no_goal():
    row = speed.Speed("garden", "torch", 0.1, 15.9, 20.0, 16.0, 1e-7, None)
    rows = [row, replace(row, wall=16.0), replace(row, goal=None)]
    assert [each.reached for each in rows] == [False, True, None]
    text = speed.table(rows)
    assert text.startswith("1 of 2 targets are reached on ")
    assert "| garden, torch | 16 | 15.9 | 20.0 | 100.0 | 1.0e-07 | 0.0e+00 | **no** |" in text


def test_no_run_begins_once_the_budget_is_spent():
    runs = []
    jobs = {name: lambda name=name: runs.append(name) for name in "ab"}
    timed_together(jobs, 2)
    assert "".join(runs) == "ababab"  # they take turns, after a warm-up
    slow, _ = timed(lambda: runs.append("c"), 3, budget=-1.0)
    assert runs.count("c") == 1  # slow work is not run twice
    assert slow.wall >= 0 <= slow.cpu


def test_machine_and_commit_are_words():
    assert f"{os.cpu_count()} cores, torch " in machine()
    assert commit().strip()


def test_the_garden_is_made_of_its_points(points):
    with np.load(points) as file:
        means = file["means3d"]
    kept = (np.abs(means) <= 2).all(1)
    one = speed.garden(0.5, points, view=2)
    assert one.name == "garden x0.5, view 2"
    assert (one.camera.width, one.camera.height, one.camera.fx) == (32, 24, 30.0)
    assert np.allclose(one.scene.means, means[kept], atol=1e-6)  # float32
    assert one.scene.scales.min() >= 0.99e-4
    assert one.scene.scales.max() <= 0.0201
    assert 0.2 < render(one.scene, one.camera).alpha.max() <= 1


@pytest.mark.parametrize("content", [b"", b"PK nonsense", None], ids=["empty", "broken", "absent"])
def test_points_that_are_none_are_an_input_error(tmp_path, content):
    path = tmp_path / "garden.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="not the garden's points"):
        speed.garden(1.0, path)
    np.savez(path, means3d=np.zeros((2, 3)), colors=np.zeros((2, 3)))
    with pytest.raises(InputError, match="Ks"):
        speed.garden(1.0, path)
