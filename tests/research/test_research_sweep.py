"""Settings turn one knob each; a sweep measures each of them and says what failed."""

from __future__ import annotations

import warnings
from dataclasses import asdict, replace
from math import nan
from pathlib import Path

import pytest
import torch
from benchmarks import SameProcess, render_measurement
from research.renderer import settings, sweep
from research.renderer.measurements import RenderMeasurement
from research.renderer.workloads import cloud
from scenes import camera, random_cloud

from gsedit import Event
from gsedit.bench.renderer import accuracy, speed
from gsedit.errors import UsageError
from rasterizer import render


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_every_setting_turns_one_knob():
    for setting in settings.settings_of(tuple(settings.KNOBS), degree=3)[1:]:
        plain = settings.Setting(setting.knob, setting.value)
        changed = [
            name for name in ("numerics", "execution", "dtype", "degree", "resolution", "textbook")
            if getattr(setting, name) != getattr(plain, name)
        ]  # fmt: skip
        assert len(changed) == 1, setting
    labels = [(s.knob, s.value) for s in settings.settings_of(tuple(settings.KNOBS), degree=3)]
    assert len(set(labels)) == len(labels)


def test_degrees_beyond_the_scenes_and_middle_values_of_a_quick_run_are_left_out():
    assert [s.degree for s in settings.settings_of(("degree",), 2)] == [None, 0, 1]
    assert len(settings.settings_of(("degree",), 0)) == 1
    assert [s.value for s in settings.settings_of(("tile",), 0, quick=True)] == ["", "4", "32"]


def test_knobs_by_name():
    assert settings.parse_knobs("tile, stop,tile") == ("tile", "stop")
    with pytest.raises(UsageError, match=r"no knob 'speed'; there are floor, stop, "):
        settings.parse_knobs("tile,speed")


def test_settings_draw_what_they_say():
    scene, view = random_cloud(40, 0, degree=2).to(torch.float32), camera()
    drawn = settings.draw(settings.Setting(), scene, view)
    assert torch.equal(drawn, render(scene, view).color)
    flat = settings.draw(settings.Setting(degree=0), scene, view)
    assert torch.equal(flat, render(replace(scene, sh=scene.sh[:, :1]), view).color)
    half = settings.draw(settings.Setting(resolution=0.5), scene, view)
    assert half.shape == drawn.shape
    assert 0 < (half - drawn).abs().mean() < 0.2 * drawn.abs().mean() + 0.05
    textbook = settings.draw(settings.Setting(textbook=True), scene, view)
    assert textbook.dtype == torch.float32
    # float32 rounding of conics and products of some tens of factors, and the stop at 1e-5
    assert (textbook - drawn).abs().max() < 1e-4


def plan(*knobs: str) -> sweep.SweepPlan:
    return sweep.SweepPlan(knobs, runs=1)


def fog() -> speed.Workload:
    """So dense that every tile is opaque before its list has ended."""
    one = cloud(600, 24, 16)
    scene = one.scene
    thick = replace(
        scene,
        log_scales=scene.log_scales + 1,
        logit_opacities=torch.full_like(scene.logit_opacities, 3),
    )
    return replace(one, scene=thick)


def test_a_sweep_yields_measurements_and_events(tmp_path):
    items = list(sweep.sweep([fog()], plan("stop", "dtype"), tmp_path))
    events = [item for item in items if isinstance(item, Event)]
    rows = {item.label: item for item in items if isinstance(item, RenderMeasurement)}
    assert events[0].note == "reference in float64"
    assert (events[-1].step, events[-1].steps) == (6, 6)
    assert list(rows) == [
        "default", "stop 0", "stop 0.0001", "stop 0.001", "stop 0.01", "dtype float64",
    ]  # fmt: skip
    default = rows["default"]
    assert (default.gaussians, default.width, default.height) == (600, 24, 16)
    assert default.forward_wall > 0
    assert default.both_wall > default.forward_wall / 10
    assert (default.runs, default.threads) == (1, torch.get_num_threads())
    # the targets for float32: nothing here is within rounding of the floor
    assert default.error_mean < 1e-6
    assert default.gradient_error < 2e-4
    assert default.gradient_cosine > 0.999999
    assert rows["stop 0.01"].error_mean > rows["stop 0"].error_mean
    assert rows["dtype float64"].dtype == "float64"
    if Path("/proc/self/clear_refs").exists():
        assert all(row.peak_bytes is not None for row in rows.values())


def test_a_failed_setting_is_a_row_with_its_reason(tiny, monkeypatch):
    monkeypatch.setattr(sweep, "Worker", SameProcess)

    def fail(*_, **__):
        raise RuntimeError("no\ncompiler")

    monkeypatch.setattr(settings, "render", fail)
    items = sweep.sweep([tiny], plan("baseline"))
    first, second = (item for item in items if isinstance(item, RenderMeasurement))
    assert first.note == "RuntimeError: no compiler"
    assert first.forward_wall is None
    assert second.error_mean < 1e-6


@pytest.mark.filterwarnings("ignore:no C")
def test_a_renderers_warning_is_the_note(tiny, monkeypatch):
    """As where there is no compiler, and the compiled row is an eager one."""

    def warn(*args, **options):
        warnings.warn("no C++ compiler", stacklevel=1)
        return render(*args, **options)

    monkeypatch.setattr(settings, "render", warn)
    monkeypatch.setattr(sweep, "Worker", SameProcess)
    first, *_ = (
        item for item in sweep.sweep([tiny], plan()) if isinstance(item, RenderMeasurement)
    )
    assert first.note == "no C++ compiler"
    assert first.forward_wall > 0


def test_a_picture_of_nan_is_noted(tiny):
    broken = accuracy.Errors(nan, nan, nan)
    measured = ("runs", "wall", "cpu", "error", "gradient_", "peak", "note")
    fields = {
        name: value
        for name, value in asdict(render_measurement()).items()
        if not any(part in name for part in measured)
    }
    measurement = sweep._measurement(fields, wrong=broken)
    assert "NaN" in measurement.note
