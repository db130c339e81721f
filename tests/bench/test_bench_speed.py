"""Speed and errors of the renderer: every case is measured; the garden is made of its points."""

import numpy as np
import pytest

from gsedit import Event
from gsedit.bench.renderer import speed
from gsedit.bench.renderer.speed import timed_together
from rasterizer import render


@pytest.fixture
def points(tmp_path):
    """A garden of 400 points, as the real file is made."""
    path = tmp_path / "garden.npz"
    rng = np.random.default_rng(1)
    pose = np.eye(4)
    pose[2, 3] = 5.0
    k = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    np.savez(path, means3d=rng.uniform(-2.5, 2.5, (400, 3)), colors=rng.integers(0, 256, (400, 3)),
             Ks=np.stack([k] * 3), viewmats=np.stack([pose] * 3), width=64, height=48)  # fmt: skip
    return path


def test_every_case_is_measured_with_its_errors(points):
    items = list(speed.measure_targets(points, 1, speed.cases(points, 200, 16, 8)))
    events = [item for item in items if isinstance(item, Event)]
    rows = [item for item in items if isinstance(item, speed.Speed)]
    assert events[-1].step == events[-1].steps == 4
    assert [row.case for row in rows if row.kernel == "torch"] == [
        "garden 64x48", "garden 16x12", "training step", "crop"
    ]  # fmt: skip
    for row in rows:
        assert row.wall > 0
        assert row.error < 1e-6
        assert (row.gradient or 0) < 1e-3
    assert speed.table(rows).count("\n| ") == len(rows) + 2  # head and rule


def test_no_run_begins_once_the_budget_is_spent():
    runs = []
    jobs = {name: lambda name=name: runs.append(name) for name in "ab"}
    timed_together(jobs, 2)
    assert "".join(runs) == "ababab"  # they take turns, after a warm-up
    slow = timed_together({"c": lambda: runs.append("c")}, 3, budget=-1.0)["c"]
    assert runs.count("c") == 1  # slow work is not run twice
    assert slow.wall >= 0 <= slow.cpu


def test_the_garden_is_made_of_its_points(points):
    with np.load(points) as file:
        means = file["means3d"]
    kept = (np.abs(means) <= 2).all(1)
    scene, camera = speed.garden(0.5, points)
    assert (camera.width, camera.height, camera.fx) == (32, 24, 30.0)
    assert np.allclose(scene.means, means[kept], atol=1e-6)  # float32
    assert scene.scales.min() >= 0.99e-4
    assert scene.scales.max() <= 0.0201
    assert 0.2 < render(scene, camera).alpha.max() <= 1
