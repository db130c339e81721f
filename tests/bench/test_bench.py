"""The benchmark measures what it says: clocks, counts, errors, fronts, rows, plots, commands."""

from __future__ import annotations

import itertools
import json
import math
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from math import isqrt, nan
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from bad_files import ply_bytes, scene_table
from gsedit_cli import main as cli
from PIL import Image
from scenes import camera, gaussian, random_cloud
from typer.testing import CliRunner

import gsedit.bench.renderer
from gsedit.bench import measure
from gsedit.bench.curves import pareto, slope
from gsedit.bench.renderer import accuracy, pairs, peers, plots, rows, sweep, workloads
from gsedit.bench.renderer import targets as bars
from gsedit.bench.renderer.worker import Worker, WorkerError, peak_memory
from gsedit.errors import InputError, UsageError
from gsedit.reports.events import Event
from gsedit.reports.json_lines import write_line
from rasterizer import render
from rasterizer.numerics import DEFAULT
from rasterizer.tiles import TILE_SIZES


@pytest.fixture
def tiny() -> workloads.Workload:
    return workloads.cloud(60, 24, 16)


# ---- clocks --------------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """Time stands still but for what is added to `now`; cpu time goes twice as fast."""
    state = SimpleNamespace(now=0.0)
    monkeypatch.setattr(measure.time, "perf_counter", lambda: state.now)
    monkeypatch.setattr(measure.time, "process_time", lambda: 2 * state.now)
    return state


def test_the_yardstick_is_the_time_of_the_arithmetic_of_25_million_pairs(monkeypatch, clock):
    sizes = []
    product = torch.mm

    def mm(a, b, out):
        clock.now += 1.0
        sizes.append((out.numel(), a.shape[1]))
        return product(a, b, out=out)

    monkeypatch.setattr(measure.torch, "mm", mm)
    seconds = measure.yardstick(pieces=4)
    assert sizes == [(2**18, 6)] * 4
    assert seconds == pytest.approx(25e6 / 2**18)  # a second a piece


def test_the_yardstick_meets_no_denormal_number():
    """They are five times slower on some processors, and its own."""
    measure.yardstick(pieces=1)
    *_, result = measure._piece()
    assert result.min() > torch.finfo(torch.float32).tiny
    assert result.max() <= 1


def works(clock, *durations):
    """Work that takes so long, one duration after the other, and gives the number of its run."""
    left = iter(enumerate(durations))

    def work():
        run, seconds = next(left)
        clock.now += seconds
        return run

    return work


def test_a_timing_is_the_median_without_the_warm_up(monkeypatch, clock):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    timing, result = measure.timed(works(clock, 100.0, 5.0, 1.0, 3.0), runs=3)
    assert timing == measure.Timing(3.0, 6.0, 3, 0.25)
    assert result == 3


def test_no_run_begins_once_the_budget_is_spent(monkeypatch, clock):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    timing, _ = measure.timed(works(clock, 1.0, 2.0, 2.0, 9.0), runs=3, budget=4.0)
    assert (timing.wall, timing.runs) == (2.0, 2)
    slow, _ = measure.timed(works(clock, 7.0), runs=3, budget=4.0)
    assert (slow.wall, slow.runs) == (7.0, 1)  # the warm-up is the run: slow work is not repeated


def test_works_that_are_compared_take_turns(monkeypatch):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    order = []
    jobs = {name: lambda name=name: order.append(name) for name in "ab"}
    timings, _ = measure.timed_together(jobs, runs=2)
    assert "".join(order) == "ababab"
    assert set(timings) == {"a", "b"}


def test_a_yardstick_pass_lies_between_the_runs(monkeypatch):
    order = []
    monkeypatch.setattr(measure, "yardstick", lambda _: order.append("y") or 1.0)
    measure.timed(lambda: order.append("w"), runs=2)
    assert "".join(order) == "ywywyw"


def test_machine_and_commit_are_words():
    assert f"{os.cpu_count()} cores, torch " in measure.machine()
    assert measure.commit().strip()


# ---- counts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("stop", [0.0, 0.3])
def test_contributing_pairs_are_those_of_the_sum_pixel_by_pixel(tiny, stop):
    """Against the definition: every Gaussian at every pixel, front to back, in float64."""
    numerics = replace(DEFAULT, transmittance_min=stop)
    scene, view = tiny.scene.to(torch.float64), tiny.camera
    flat = pairs._flattened(scene, view, numerics, sweep.AUTO)
    front = flat.bins.rank.argsort()
    offset = view.pixel_centres()[:, :, None] - flat.xy[front]
    w0, w1, w2 = flat.whitening[front].unbind(-1)
    u, v = w0 * offset[..., 0], w1 * offset[..., 0] + w2 * offset[..., 1]
    alpha = (flat.log_opacities[front] - 0.5 * (u * u + v * v)).exp().clamp_max(numerics.alpha_max)
    alpha = torch.where(alpha >= numerics.alpha_min, alpha, 0.0)
    passed = torch.cat((torch.ones_like(alpha[..., :1]), (1 - alpha).cumprod(-1)[..., :-1]), -1)
    wanted = int(((alpha > 0) & (passed > stop)).sum())
    assert 0 < wanted < alpha.numel()
    assert pairs.contributing_pairs(scene, view, numerics) == wanted


def test_the_stop_and_the_floor_leave_pairs_out(tiny):
    def count(**numbers):
        return pairs.contributing_pairs(tiny.scene, tiny.camera, replace(DEFAULT, **numbers))

    assert count(transmittance_min=0.5) < count()
    assert count(alpha_min=0.1) < count()


def test_smaller_tiles_look_at_fewer_pixels_in_more_pairs(tiny):
    few, many = (
        pairs.listed_pairs(tiny.scene, tiny.camera, execution=replace(sweep.AUTO, tile_size=side))
        for side in (4, 16)
    )
    assert few[1] == 16 * few[0]
    assert many[1] == 256 * many[0]
    assert few[0] > many[0]
    assert few[1] < many[1]


def test_an_alpha_at_the_floor_is_seen():
    """One Gaussian of opacity 1/2: on the circle where it falls to the floor, and off it."""
    view = camera()
    one = gaussian((0.0, 0.0, 2.0), (0.3, 0.3, 0.3), opacity=0.5)
    flat = pairs._flattened(one, view, DEFAULT, sweep.AUTO)
    offset = view.pixel_centres() - flat.xy[0]
    w0, w1, w2 = flat.whitening[0]
    power = 0.5 * (
        (w0 * offset[..., 0]).square() + (w1 * offset[..., 0] + w2 * offset[..., 1]).square()
    )
    alpha = 0.5 * (-power).exp()
    pixels = torch.tensor([[16, 28], [0, 0], [16, 30]])
    floor = float(alpha[16, 30])  # so that the last pixel lies on the circle
    numerics = replace(DEFAULT, alpha_min=floor)
    found = pairs.nearest_to_floor(one, view, pixels, numerics)
    assert found[2] < 1e-12  # some roundings in float64
    ratio = float(alpha[16, 28] / floor)
    assert 1 < ratio < 2
    assert found[0] == pytest.approx(ratio - 1)
    assert found[1] == pytest.approx(1.0)  # nothing is near
    nothing = pairs.nearest_to_floor(one[:0], view, pixels)
    assert len(nothing) == 3
    assert nothing.min() == 1


def test_nothing_in_sight_is_no_pair(tiny):
    nothing = tiny.scene[:0]
    assert pairs.listed_pairs(nothing, tiny.camera) == (0, 0)
    assert pairs.contributing_pairs(nothing, tiny.camera) == 0


# ---- errors --------------------------------------------------------------------------------------


def test_picture_errors_are_mean_tail_and_largest():
    truth = torch.zeros(100, 10, 3)
    found = truth.clone()
    found[0, 0, 0], found[5, 5, 1] = -0.5, 0.25  # 2 of 3,000: beyond the 99.9 %
    mean, tail, largest = accuracy.picture_errors(found, truth)
    assert mean == pytest.approx(0.75 / 3000)
    assert (tail, largest) == (0.0, 0.5)
    found[:2] = 1.0  # 2 % are not
    assert accuracy.picture_errors(found, truth)[1] == 1.0


def test_the_worst_gradient_counts():
    picture = torch.zeros(2, 2, 3)
    truth = {"a": torch.tensor([3.0, 4.0]), "b": torch.tensor([1.0, 0.0])}
    found = {"a": torch.tensor([3.0, 4.5]), "b": torch.tensor([0.0, 1.0])}
    got = accuracy.errors(accuracy.Drawn(picture, found), accuracy.Drawn(picture, truth))
    assert got.gradient == pytest.approx(math.sqrt(2))
    assert got.cosine == pytest.approx(0.0)
    alone = accuracy.Drawn(picture, {"a": found["a"]})
    assert accuracy.errors(alone, accuracy.Drawn(picture, truth)).gradient == pytest.approx(0.1)


def test_gradients_that_should_be_zero():
    zero, one = torch.zeros(3), torch.ones(3)
    assert accuracy.relative(zero, zero) == 0.0
    assert accuracy.cosine(zero, zero) == 1.0
    assert accuracy.relative(one, zero) == pytest.approx(math.sqrt(3))
    assert accuracy.cosine(one, zero) == 0.0


def test_the_truth_is_kept_and_never_stale(tiny, tmp_path, monkeypatch):
    first = accuracy.truth_of(tiny.scene, tiny.camera, tmp_path)
    assert first.picture.dtype == torch.float64
    assert set(first.gradients) == {*accuracy.FIELDS, accuracy.POSE}
    monkeypatch.setattr(accuracy.reference, "render_reference", None)  # to be called no more
    again = accuracy.truth_of(tiny.scene, tiny.camera, tmp_path)
    assert torch.equal(again.picture, first.picture)
    assert all(torch.equal(again.gradients[n], first.gradients[n]) for n in first.gradients)
    moved = replace(tiny.camera, cx=tiny.camera.cx + 1)
    with pytest.raises(TypeError):
        accuracy.truth_of(tiny.scene, moved, tmp_path)


# ---- fronts and slopes ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_the_front_is_what_nothing_beats(seed):
    numbers = np.random.default_rng(seed).integers(0, 6, (seed, 2)).astype(float)  # many ties
    points = [(float(x), float(y)) for x, y in numbers]

    def beaten(point):
        return any(q != point and q[0] <= point[0] and q[1] <= point[1] for q in points)

    assert pareto(points) == sorted({p for p in points if not beaten(p)})


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1.0, 2.5])
def test_the_slope_of_a_power_is_its_exponent(exponent):
    points = [(x, 3 * x**exponent) for x in (1.0, 10.0, 50.0, 1e4)]
    assert slope(points) == pytest.approx(exponent, abs=1e-12)  # a dozen roundings in float64


@pytest.mark.parametrize(
    "points", [[], [(1.0, 1.0)], [(2.0, 1.0), (2.0, 3.0)], [(0.0, 1.0), (1.0, 1.0)]]
)
def test_a_slope_needs_two_positive_points(points):
    with pytest.raises(ValueError, match=r"needs two|positive"):
        slope(points)


# ---- rows ----------------------------------------------------------------------------------------


def row(**fields) -> rows.Row:
    values = dict(
        scene="columns", implementation="gsedit", knob="default", value="", gaussians=1000,
        width=64, height=48, pairs=5000, evaluated=320_000, contributing=90_000, dtype="float32",
        threads=2, runs=5, forward_wall=0.030, forward_cpu=0.055, both_wall=0.090, both_cpu=0.160,
        yardstick=0.015, error_mean=8e-8, error_tail=2e-6, error_max=3e-4, gradient_error=2e-5,
        gradient_cosine=1 - 1e-9, peak_bytes=50_000_000, note="", commit="abc1234",
        machine="A processor, 2 cores, torch 2.13.0", date="2026-01-02T03:04:05+00:00",
    )  # fmt: skip
    return rows.Row(**(values | fields))


STOPS = [
    row(knob="stop", value=value, forward_wall=wall, both_wall=3 * wall, error_mean=error,
        gradient_error=100 * error)
    for value, wall, error in (("0", 0.04, 7e-8), ("0.001", 0.02, 1e-5), ("0.01", 0.015, 3e-4))
]  # fmt: skip


def test_rows_survive_json(tmp_path):
    wanted = [row(), row(knob="peers", value="gsplat", forward_wall=None, note="raised")]
    with (tmp_path / "bench.jsonl").open("w") as file:
        for one in wanted:
            write_line(file, one)
        file.write('{"scene": "cut o')  # interrupted in the middle of a line
    assert rows.read_rows(tmp_path / "bench.jsonl") == wanted


def test_what_is_not_a_number_is_null(tmp_path):
    with (tmp_path / "bench.jsonl").open("w") as file:
        write_line(file, row(error_mean=nan, error_max=math.inf))
    (found,) = rows.read_rows(tmp_path / "bench.jsonl")
    assert found == row(error_mean=None, error_max=None)


def test_a_line_that_is_no_row_is_named(tmp_path):
    path = tmp_path / "bench.jsonl"
    path.write_text('{"stage": "fit"}\n')
    with pytest.raises(InputError, match=r"bench.jsonl, line 1: not a measurement"):
        rows.read_rows(path)
    with pytest.raises(InputError, match="cannot be read"):
        rows.read_rows(tmp_path / "absent.jsonl")


def test_the_table_is_for_people():
    failed = row(implementation="gsplat 1.5.3", knob="peers", runs=0, note="it raised",
                 **{f: None for f in ("forward_wall", "forward_cpu", "both_wall", "both_cpu",
                                      "yardstick", "error_mean", "peak_bytes")})  # fmt: skip
    text = rows.table([row(), failed, row(scene="cage")])
    assert text.count("## ") == 2
    assert "## columns\n\n1,000 Gaussians, 64x48, float32; 0.005 / 0.32 / 0.09 million" in text
    line = next(part for part in text.splitlines() if part.startswith("| **default**"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["**default**", "30", "2.0", "3.7", "90", "6.0", "10.7", "8.0e-08", "2.0e-06",
                     "3.0e-04", "2.0e-05", "1.0e-09", "50", "5"]  # fmt: skip
    assert "- gsplat 1.5.3: it raised" in text
    widths = {len(part.split("|")) for part in text.splitlines() if part.startswith("|")}
    assert widths == {len(rows.HEAD) + 2}


def test_a_comparison_is_in_yardsticks():
    old = row(forward_wall=0.060, yardstick=0.030, both_wall=0.36)  # a machine half as fast
    text = rows.comparison([row(), row(knob="tile", value="4")], [old])
    (line,) = [part for part in text.splitlines() if "columns" in part]
    assert [c.strip() for c in line.strip("|").split("|")] == [
        "columns: default", "1.00", "0.50", "1.00", "1.00",
    ]  # fmt: skip


# ---- the other process ---------------------------------------------------------------------------


def test_another_process_calls_fails_and_comes_back():
    with Worker() as worker:
        assert worker.call(math.hypot, 3.0, 4.0) == 5.0
        assert worker.call(torch.get_num_threads) == torch.get_num_threads()
        with pytest.raises(WorkerError, match=r"^ValueError: .*math domain"):
            worker.call(math.sqrt, -1.0)
        pid = worker.call(os.getpid)
        with pytest.raises(WorkerError, match=r"ended \(SIGABRT\)"):
            worker.call(os.abort)
        assert worker.call(os.getpid) != pid
        if Path("/proc/self/clear_refs").exists():
            count = 16_000_000
            peak = worker.call(peak_memory, torch.ones, count)
            # a page table and what the first allocation of a process brings along
            assert 4 * count <= peak < 4 * count + 8e6
            assert worker.call(peak_memory, torch.ones, 10) < 1e6  # the earlier peak is forgotten


# ---- settings and the sweep ----------------------------------------------------------------------


def test_every_setting_turns_one_knob():
    for setting in sweep.settings(tuple(sweep.KNOBS), degree=3)[1:]:
        plain = sweep.Setting(setting.knob, setting.value)
        changed = [
            name for name in ("numerics", "execution", "dtype", "degree", "resolution", "textbook")
            if getattr(setting, name) != getattr(plain, name)
        ]  # fmt: skip
        assert len(changed) == 1, setting
    labels = [(s.knob, s.value) for s in sweep.settings(tuple(sweep.KNOBS), degree=3)]
    assert len(set(labels)) == len(labels)


def test_degrees_beyond_the_scenes_and_most_values_of_a_first_look_are_left_out():
    assert [s.degree for s in sweep.settings(("degree",), 2)] == [None, 0, 1]
    assert len(sweep.settings(("degree",), 0)) == 1
    assert [s.value for s in sweep.settings(("tile",), 0, quick=True)] == ["", "4", "32"]


def test_knobs_by_name():
    assert sweep.parse_knobs("tile, stop,tile") == ("tile", "stop")
    with pytest.raises(UsageError, match=r"no knob 'speed'; there are floor, stop, "):
        sweep.parse_knobs("tile,speed")


def test_settings_draw_what_they_say():
    scene, view = random_cloud(40, 0, degree=2).to(torch.float32), camera()
    drawn = sweep.draw(sweep.Setting(), scene, view)
    assert torch.equal(drawn, render(scene, view).color)
    flat = sweep.draw(sweep.Setting(degree=0), scene, view)
    assert torch.equal(flat, render(replace(scene, sh=scene.sh[:, :1]), view).color)
    half = sweep.draw(sweep.Setting(resolution=0.5), scene, view)
    assert half.shape == drawn.shape
    assert 0 < (half - drawn).abs().mean() < 0.2 * drawn.abs().mean() + 0.05
    textbook = sweep.draw(sweep.Setting(textbook=True), scene, view)
    assert textbook.dtype == torch.float32
    # float32 rounding of conics and products of some tens of factors, and the stop at 1e-5
    assert (textbook - drawn).abs().max() < 1e-4


class SameProcess(Worker):
    """Calls functions where it stands: starting another process takes seconds."""

    def call(self, function, *args):
        return function(*args)


def plan(*knobs: str) -> sweep.Plan:
    return sweep.Plan(knobs, runs=1, pieces=1)


def fog() -> workloads.Workload:
    """So dense that every tile is opaque before its list has ended."""
    one = workloads.cloud(600, 24, 16)
    scene = one.scene
    thick = replace(
        scene,
        log_scales=scene.log_scales + 1,
        logit_opacities=torch.full_like(scene.logit_opacities, 3),
    )
    return replace(one, scene=thick)


def test_a_sweep_gives_rows_and_says_what_it_does(tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "TABLE", {"no_such_renderer": peers.Peer("no_such_renderer", print)})
    items = list(sweep.sweep([fog()], plan("stop", "dtype", "peers"), tmp_path))
    events = [item for item in items if isinstance(item, Event)]
    found = {item.label: item for item in items if isinstance(item, rows.Row)}
    assert "not installed: no_such_renderer" in events[0].note
    assert events[1].note == "reference in float64"
    assert (events[-1].step, events[-1].steps) == (6, 6)
    assert list(found) == [
        "default", "stop 0", "stop 0.0001", "stop 0.001", "stop 0.01", "dtype float64",
    ]  # fmt: skip
    default = found["default"]
    assert (default.gaussians, default.width, default.height) == (600, 24, 16)
    assert default.contributing <= default.evaluated
    assert default.forward_wall > 0
    assert default.both_wall > default.forward_wall / 10
    assert (default.runs, default.threads) == (1, torch.get_num_threads())
    # what the promised bars allow float32: nothing here is within rounding of the floor
    assert default.error_mean < 1e-6
    assert default.gradient_error < 2e-4
    assert default.gradient_cosine > 0.999999
    assert found["stop 0.01"].error_mean > found["stop 0"].error_mean
    assert found["stop 0.01"].contributing < default.contributing
    assert found["dtype float64"].dtype == "float64"
    if Path("/proc/self/clear_refs").exists():
        assert all(one.peak_bytes is not None for one in found.values())


def test_a_way_of_drawing_that_fails_is_a_row_with_its_reason(tiny, monkeypatch):
    monkeypatch.setattr(sweep, "Worker", SameProcess)

    def fail(*_, **__):
        raise RuntimeError("no\ncompiler")

    monkeypatch.setattr(sweep, "render", fail)
    items = sweep.sweep([tiny], plan("baseline"))
    first, second = (item for item in items if isinstance(item, rows.Row))
    assert first.note == "RuntimeError: no compiler"
    assert first.forward_wall is None
    assert second.error_mean < 1e-6


@pytest.mark.filterwarnings("ignore:no C")
def test_what_a_renderer_warns_of_is_said(tiny, monkeypatch):
    """As where there is no compiler, and the compiled row is an eager one."""

    def warn(*args, **options):
        warnings.warn("no C++ compiler", stacklevel=1)
        return render(*args, **options)

    monkeypatch.setattr(sweep, "render", warn)
    monkeypatch.setattr(sweep, "Worker", SameProcess)
    first, *_ = (item for item in sweep.sweep([tiny], plan()) if isinstance(item, rows.Row))
    assert first.note == "no C++ compiler"
    assert first.forward_wall > 0


def test_a_picture_of_nan_is_said(tiny):
    broken = accuracy.Errors(nan, nan, nan)
    measured = ("runs", "wall", "cpu", "yardstick", "error", "gradient_", "peak", "note")
    fields = {
        name: value
        for name, value in asdict(row()).items()
        if not any(part in name for part in measured)
    }
    found = sweep._row(fields, found=broken)
    assert "NaN" in found.note


# ---- peers ---------------------------------------------------------------------------------------


def test_gsplat_is_called_as_its_documentation_says(monkeypatch):
    """With our own function of the same contract in its place, the picture is ours."""
    rasterization = pytest.importorskip("rasterizer.rasterization").rasterization
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    one = workloads.Workload("cloud", random_cloud(40, 0, degree=1).to(torch.float32), camera())
    measured = peers.measured("gsplat", one, runs=1, budget=1.0, pieces=1)
    wanted = accuracy.truth_of(one.scene, one.camera)
    got = accuracy.errors(measured.drawn, wanted)
    assert got.mean < 5e-6  # the bar of the default stop
    assert got.gradient < 2e-4
    assert measured.both.wall > 0


def test_mitsuba_gets_the_scene_in_its_own_words(tiny):
    mi = SimpleNamespace(TensorXf=np.asarray, ScalarTransform4f=np.asarray)
    shifted = replace(tiny.camera, cx=tiny.camera.cx + 6)
    words = peers.mitsuba_scene(mi, replace(tiny, camera=shifted))
    sensor, splats = words["sensor"], words["primitives"]
    assert sensor["principal_point_offset_x"] == pytest.approx(-6 / 24)
    assert math.tan(math.radians(sensor["fov"] / 2)) == pytest.approx(12 / shifted.fx)
    forward = sensor["to_world"] @ np.array([0, 0, 1, 0])
    assert np.allclose(forward[:3], shifted.forward)
    assert splats["quaternions"].shape == (60, 4)
    w = splats["quaternions"][:, 3] * tiny.scene.quats.norm(dim=1).numpy()
    assert np.allclose(w, tiny.scene.quats[:, 0], atol=1e-6)  # real part last; float32
    assert np.allclose(splats["opacities"][:, 0], tiny.scene.opacities)


# ---- workloads -----------------------------------------------------------------------------------


@pytest.fixture
def points(tmp_path) -> Path:
    """A garden of 400 points, as the real file is made."""
    rng = np.random.default_rng(1)
    pose = np.eye(4)
    pose[2, 3] = 5.0
    k = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    path = tmp_path / "garden.npz"
    np.savez(path, means3d=rng.uniform(-2.5, 2.5, (400, 3)), colors=rng.integers(0, 256, (400, 3)),
             Ks=np.stack([k] * 3), viewmats=np.stack([pose] * 3), width=64, height=48)  # fmt: skip
    return path


def test_the_garden_is_made_of_its_points(points):
    with np.load(points) as file:
        means = file["means3d"]
    kept = (np.abs(means) <= 2).all(1)
    one = workloads.garden(0.5, points, view=2)
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
        workloads.garden(1.0, path)


def test_points_without_cameras_are_an_input_error(tmp_path):
    np.savez(tmp_path / "garden.npz", means3d=np.zeros((2, 3)), colors=np.zeros((2, 3)))
    with pytest.raises(InputError, match="Ks"):
        workloads.garden(1.0, tmp_path / "garden.npz")


def test_clouds_have_the_same_work_a_gaussian_at_every_size():
    small, large = (workloads.cloud(n, *bars.pixels_for(n)) for n in (2_000, 8_000))
    a, b = (pairs.contributing_pairs(w.scene, w.camera) / len(w.scene) for w in (small, large))
    assert a == pytest.approx(b, rel=0.1)  # borders, and the draw of some thousand sizes


# ---- plots ---------------------------------------------------------------------------------------


def rgb(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(int)


def near(pixels: np.ndarray, color: str) -> int:
    """Pixels of a colour."""
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int((np.abs(pixels - wanted).max(1) <= 6).sum())


@pytest.mark.parametrize("which", ["image", "gradients"])
def test_the_plot_shows_points_front_and_defaults(tmp_path, which):
    path = tmp_path / "plot.png"
    plots.work_precision([row(), *STOPS, row(scene="cage")], path, which)
    pixels = rgb(path)
    assert near(pixels, plots.STYLES["stop"][0]) > 100
    assert near(pixels, "#bbbbbb") > 300  # the front
    assert near(pixels, plots.STYLES["tile"][0]) < 20  # nothing of what was not measured
    assert near(pixels, "#ffffff") > 0.5 * len(pixels)


def test_a_plot_of_nothing_says_so(tmp_path):
    failed = row(forward_wall=None, both_wall=None, note="it raised")
    plots.work_precision([failed], tmp_path / "a.png", "image")
    plots.work_precision([], tmp_path / "b.png", "image")
    assert near(rgb(tmp_path / "a.png"), "#000000") > 100


def test_errors_of_zero_have_their_place(tmp_path):
    exact = row(knob="dtype", value="float64", error_mean=0.0)
    mark = plots._mark(exact, "image")
    assert mark.error == plots.FLOOR
    assert mark.value == "float64 (0e+00)"
    plots.work_precision([row(), exact], tmp_path / "a.png", "image")


def test_labels_find_room_or_stay_away():
    window = (0.0, 0.0, 200.0, 100.0)
    taken: list = []
    for x, y in itertools.product(range(10, 200, 30), range(10, 100, 20)):
        place = plots._free(float(x), float(y), 24.0, 9.0, taken, window)
        if place is None:
            continue
        box = (*place, place[0] + 24, place[1] + 9)
        assert not any(plots.overlap(box, other) for other in taken)
        assert box[0] >= 0
        assert box[1] >= 0
        assert box[2] <= 200
        assert box[3] <= 100
        taken.append(box)
    assert len(taken) > 10
    assert plots._free(100.0, 50.0, 24.0, 9.0, [window], window) is None


# ---- bars ----------------------------------------------------------------------------------------


def test_every_bar_is_measured(points, tmp_path, monkeypatch):
    cage = workloads.cloud(80, 32, 24)
    monkeypatch.setattr(bars, "synthetic", lambda: [replace(cage, name="cage")])
    monkeypatch.setattr(bars, "Worker", SameProcess)
    size = bars.Size(runs=1, pieces=1, clouds=(100, 400))
    found = list(bars.measure_bars(size, points, [], tmp_path / "references"))
    events = [item for item in found if isinstance(item, Event)]
    told = [item for item in found if isinstance(item, bars.Bar)]
    assert events[-1].step == events[-1].steps > 0
    names = " ".join(bar.name for bar in told)
    for part in ("compiled, forward", "no early stop: mean", "default stop: gradients",
                 "cage: tile choice", "quarters as crops", "2 threads", "memory above the inputs",
                 "time by pairs", "memory by pairs"):  # fmt: skip
        assert part in names
    by_name = {bar.name: bar for bar in told}
    for scale in (1, 0.25):
        label = f"garden x{scale}, float32, no early stop"
        assert by_name[f"{label}: mean error"].reached
        assert by_name[f"{label}: 99.9 %"].reached
        assert by_name[f"{label}: gradients"].reached
    assert bars.table(told).count("\n| ") == len(told) + 2  # head and rule


def test_without_its_points_the_garden_is_left_out_and_said(monkeypatch):
    monkeypatch.setattr(bars, "synthetic", list)
    monkeypatch.setattr(bars, "scaling_bars", lambda _: [])
    events = list(bars.measure_bars(bars.QUICK, None, []))
    assert "not given" in events[0].note
    assert not any(isinstance(item, bars.Bar) for item in events)


@pytest.mark.parametrize(("chosen", "reached"), [(1.05, True), (1.3, False)])
def test_a_bar_is_missed_where_it_is_missed(tiny, monkeypatch, chosen, reached):
    pairs_, pixels = pairs.listed_pairs(tiny.scene, tiny.camera)
    side = isqrt(pixels // pairs_)
    other = max(set(TILE_SIZES) - {side})
    seconds = dict.fromkeys(TILE_SIZES, 2.0) | {other: 1.0, side: chosen}
    timings = {name: measure.Timing(s, s, 5, 0.015) for name, s in seconds.items()}
    monkeypatch.setattr(bars, "timed_together", lambda *_, **__: (timings, {}))
    (bar,) = bars.tile_bars(tiny, bars.QUICK)
    assert bar.reached is reached
    assert bar.measured.startswith(f"{side}: {chosen:.2f} of {other} ")


def test_two_threads_are_given_back(tiny, monkeypatch):
    before = torch.get_num_threads()
    monkeypatch.setattr(bars, "differentiate", lambda *_: None)
    monkeypatch.setattr(bars.os, "cpu_count", lambda: 2)
    bars.thread_bars(tiny, bars.Size(runs=1, pieces=1))
    assert torch.get_num_threads() == before
    monkeypatch.setattr(bars.os, "cpu_count", lambda: 1)
    (alone,) = bars.thread_bars(tiny, bars.QUICK)
    assert alone.reached is None


def test_a_slope_above_one_is_not_linear():
    line = [(x, 2.0 * x) for x in (1.0, 10.0, 100.0)]
    square = [(x, x * x) for x in (1.0, 10.0, 100.0)]
    assert bars.slope_bar("time", line, "").reached is True
    assert bars.slope_bar("time", square, "").reached is False
    assert bars.slope_bar("time", [], "no peak").reached is None


def test_the_table_of_bars_hides_nothing():
    told = [
        bars.Bar("fast", "8 Y wall", "9.1 Y wall", False),
        bars.Bar("right", "1e-06", "8e-08", True),
        bars.Bar("lean", "2.5 GB", "no peak", None),
    ]
    text = bars.table(told)
    assert text.startswith("1 of 2 bars are reached on ")
    assert "| fast | 8 Y wall | 9.1 Y wall | **no** |" in text
    assert "| lean | 2.5 GB | no peak | not measured |" in text


# ---- the command line ----------------------------------------------------------------------------


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes(scene_table(40)))
    return path


@pytest.fixture
def alone(monkeypatch):
    """No synthetic scenes, no garden: only what is named."""
    monkeypatch.delenv("GSEDIT_GARDEN", raising=False)
    monkeypatch.setattr(workloads, "synthetic", list)
    monkeypatch.setattr(sweep, "Worker", SameProcess)


def gsedit_bench(*words: object):
    return CliRunner().invoke(cli.app, ["bench", *(str(word) for word in words)])


QUICK = ("--quick", "--runs", "1", "--knobs", "stop,tile")


@pytest.mark.usefixtures("alone")
def test_rasterizer_leaves_its_folder(scene, tmp_path):
    out = tmp_path / "out"
    done = gsedit_bench("rasterizer", scene, "-o", out, *QUICK)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out / 'bench.md'}\n"
    assert "the garden is left out" in done.stderr
    found = rows.read_rows(out / "bench.jsonl")
    assert [one.label for one in found] == ["default", "stop 0", "stop 0.01", "tile 4", "tile 32"]
    assert {one.scene for one in found} == {"scene, 1 in 8"}
    assert "| tile 4 |" in (out / "bench.md").read_text()
    for name in ("image_error.png", "gradient_error.png"):
        assert near(rgb(out / name), plots.STYLES["stop"][0]) > 50

    refused = gsedit_bench("rasterizer", scene, "-o", out, *QUICK)
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert "add -f" in refused.stderr

    again = gsedit_bench(
        "rasterizer", scene, "-o", out, *QUICK[:-1], "tile", "-f", "--json", "--compare",
        out / "bench.jsonl",
    )  # fmt: skip
    assert again.exit_code == 0, again.stderr
    lines = [json.loads(line) for line in again.stdout.splitlines()]
    assert {line["type"] for line in lines} == {"event", "row", "result"}
    told = [line["value"] for line in lines if line["type"] == "row"]
    assert told == ["", "4", "32"]
    assert lines[-1]["rows"] == 3
    assert len(lines[-1]["compared"].splitlines()) == 2 + 3
    assert len(rows.read_rows(out / "bench.jsonl")) == 3


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["{scene}", "--knobs", "speed"], 2, "no knob 'speed'"),
        (["{broken}"], 3, "broken.ply"),
        (["{scene}", "--points", "{broken}"], 3, "not the garden's points"),
        (["{scene}", "--compare", "{broken}"], 3, "not a measurement"),
        (["{scene}", "--runs", "0"], 2, "runs"),
        ([], 2, "nothing to measure"),
    ],
)
def test_what_cannot_be_measured_is_one_line(scene, tmp_path, words, code, said):
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat\n")
    paths = {"scene": scene, "broken": tmp_path / "broken.ply"}
    done = gsedit_bench("rasterizer", *(w.format(**paths) for w in words), "-o", tmp_path / "out")
    assert done.exit_code == code
    assert said in done.stderr.splitlines()[-1]
    assert done.stdout == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("alone")
def test_an_interrupted_sweep_keeps_its_rows(scene, tmp_path, monkeypatch):
    def interrupted(*_) -> Iterator[rows.Row]:
        yield row()
        yield row(knob="tile", value="4")
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, "sweep", interrupted)
    done = gsedit_bench("rasterizer", scene, "-o", tmp_path / "out")
    assert done.exit_code == 130
    assert "interrupted; 2 rows are in" in done.stderr.splitlines()[-1]
    assert len(rows.read_rows(tmp_path / "out" / "bench.jsonl")) == 2


def test_bars_that_are_missed_are_told_and_end_well(monkeypatch):
    missed = bars.Bar("fast", "8 Y wall", "9.1 Y wall", False)
    monkeypatch.setattr(bars, "measure_bars", lambda *_: iter([Event("bars", 0.0, 0, 1), missed]))
    done = gsedit_bench("bars")
    assert done.exit_code == 0
    assert "| fast | 8 Y wall | 9.1 Y wall | **no** |" in done.stdout
    told = json.loads(gsedit_bench("bars", "--json").stdout.splitlines()[-1])
    assert told["bars"] == [{"name": "fast", "goal": "8 Y wall", "measured": "9.1 Y wall",
                             "reached": False}]  # fmt: skip
    assert told["reached"] == 0


@dataclass(frozen=True)
class EdgeCase:
    """The part of a museum's row that the command needs to know."""

    name: str
    error: float


def test_stability_writes_the_museums_table(tmp_path, monkeypatch):
    museum = SimpleNamespace(
        rows=lambda quick: iter([EdgeCase(f"needle, quick {quick}", nan)]),
        table=lambda found: f"{len(found)} row",
    )
    monkeypatch.setattr(gsedit.bench.renderer, "stability", museum, raising=False)
    done = gsedit_bench("stability", "-o", tmp_path / "out", "--quick")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "1 row\n"
    assert (tmp_path / "out" / "stability.md").read_text() == "1 row\n"
    (line,) = (tmp_path / "out" / "stability.jsonl").read_text().splitlines()
    assert json.loads(line) == {"name": "needle, quick True", "error": None}
    assert "needle" in done.stderr
    assert gsedit_bench("stability", "-o", tmp_path / "out").exit_code == 2


@pytest.mark.parametrize("verb", ["rasterizer", "stability", "bars"])
def test_help_shows_an_example(verb):
    done = gsedit_bench(verb, "--help")
    assert done.exit_code == 0
    assert f"gsedit bench {verb} " in done.stdout
