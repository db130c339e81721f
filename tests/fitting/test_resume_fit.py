"""A fit that goes on from a checkpoint ends where the uninterrupted one ends."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from small_scenes import generator, scenes, traced_dataset

from gsedit import Checkpoint, Event, FitSettings, fit_steps
from gsedit.bench.synthetic import ring_cameras
from gsedit.errors import InputError, UsageError
from gsedit.run.state import load_state, save_state

SETTINGS = FitSettings(
    steps=24,
    seconds=None,
    dense_start=50,
    densify_every=5,
    report_every=1,
    exposure="on",
    checkpoint_seconds=0.0,
)


@pytest.fixture(scope="module")
def photos():
    return traced_dataset(scenes()[0], ring_cameras(scenes()[0], 6, 32), points=200)


def first_state(photos, settings):
    """State of the first checkpoint."""
    items = fit_steps(photos, settings, generator=generator(3))
    return next(item for item in items if isinstance(item, Checkpoint)).state


def write(items, folder):
    """Checkpoints as files, by their step; the other items."""
    others = []
    for item in items:
        if isinstance(item, Checkpoint):
            save_state(item.state, folder / str(item.step))
        else:
            others.append(item)
    return others


def test_a_fit_stopped_at_any_checkpoint_ends_as_the_whole_one(photos, tmp_path):
    *events, whole = write(fit_steps(photos, SETTINGS, generator=generator(3)), tmp_path)
    for step in (3, 15, 23):  # before and after scenes grew
        state = load_state(tmp_path / str(step))
        items = fit_steps(photos, SETTINGS, generator=generator(3), resume=state)
        *after, resumed = [item for item in items if not isinstance(item, Checkpoint)]
        for name, value in vars(whole.scene).items():
            ours = getattr(resumed.scene, name)
            torch.testing.assert_close(ours, value, rtol=1e-4, atol=1e-5)
        assert resumed.steps == whole.steps
        assert resumed.psnr == pytest.approx(whole.psnr, abs=1e-3)
        assert len(resumed.curve) == len(whole.curve)
        missed = [event for event in events if isinstance(event, Event) and event.step > step]
        assert [(e.stage, e.step) for e in after] == [(e.stage, e.step) for e in missed]


def test_another_fit_does_not_go_on(photos):
    state = first_state(photos, SETTINGS)
    with pytest.raises(UsageError, match=r"settings.steps is 25, was 24"):
        next(fit_steps(photos, replace(SETTINGS, steps=25), generator=generator(3), resume=state))
    with pytest.raises(UsageError, match=r"not the fit that was interrupted: seed is 4, was 3"):
        next(fit_steps(photos, SETTINGS, generator=generator(4), resume=state))


def test_a_crafted_checkpoint_is_refused_by_its_file(photos, tmp_path):
    state, path = first_state(photos, SETTINGS), tmp_path / "state"
    names = [name for name in state.tensors if not name.startswith("exposures")]
    assert any("first." in name for name in names)
    for name in names:
        tensors = {**state.tensors, name: state.tensors[name].reshape(-1)[:1]}
        if tensors[name].shape != state.tensors[name].shape:
            save_state(replace(state, tensors=tensors), path)
            with pytest.raises(InputError, match=f"{path} is damaged"):
                next(fit_steps(photos, SETTINGS, generator=generator(3), resume=load_state(path)))
    for changed in ({"order": [9999]}, {"curve": [1]}, {"request": {}}):
        save_state(state.along_with(**changed), path)
        with pytest.raises((InputError, UsageError)):
            next(fit_steps(photos, SETTINGS, generator=generator(3), resume=load_state(path)))
