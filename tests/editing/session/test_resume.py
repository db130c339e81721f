"""An edit that goes on from a checkpoint ends where the uninterrupted one ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import deque
from dataclasses import asdict, fields, replace
from pathlib import Path

import pytest
import torch
from tiny_edits import painted, seen

from gsedit import Checkpoint, Dataset, EditResult, EditSettings, Event, edit_steps
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditProgress, make_editor
from gsedit.paper.strategies import find_strategy, strategy_names
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.run.state import load_state, save_state

pytestmark = pytest.mark.usefixtures("quick_saliency")
SETTINGS = EditSettings(
    sampler=SamplerSettings(steps=4),
    update=UpdateSettings(loss="mse+gram", patches=2, patch=16),
    views_per_batch=2,
    batches=2,
    coverage=1.0,
    held_out_edits=0,
    checkpoint_seconds=0.0,  # after every action
)


def short(name):
    """The strategy of that name with few steps: an edit takes less than a second."""
    strategy = find_strategy(name)()
    long = {f.name: getattr(strategy, f.name) for f in fields(strategy) if "steps" in f.name}
    few = {key: 2 if "between" in key else 12 for key in long}
    views = {"dataset_views": "planned"} if hasattr(strategy, "dataset_views") else {}
    return replace(strategy, **few, **views)


class Request:
    """One edit, repeated as often as asked: with a fresh generator and editor each time."""

    def __init__(self, scene, data):
        self.scene, self.data = scene, data

    def steps(self, resume=None, **changes):
        given = {
            "sentence": "as bronze",
            "editor": make_editor("closed-form"),
            "generator": torch.Generator().manual_seed(3),
            "views": self.data,
            "settings": SETTINGS,
            "strategy": SinglePass(12),
        }
        return edit_steps(self.scene, **{**given, **changes}, resume=resume)


@pytest.fixture(scope="module")
def request_():
    return Request(painted(400), seen(400, 6, 32))


def write(items, folder):
    """The checkpoints of an edit as files; its result."""
    number, item = 0, None
    for item in items:
        if isinstance(item, Checkpoint):
            save_state(item.state, folder / f"{number:03d}.safetensors")
            number += 1
    return item


def described(events):
    """Events without the time that they took."""
    return [replace(each, seconds=0.0, loss=None, error=None, note="") for each in events]


def assert_same_result(resumed: EditResult, whole: EditResult):
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
        ours, theirs = getattr(resumed.scene, name), getattr(whole.scene, name)
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)
    assert [v.name for v in resumed.targets] == [v.name for v in whole.targets]
    assert resumed.view_plan == whole.view_plan
    assert asdict(resumed.work) == asdict(whole.work)
    assert resumed.metrics.pairs == whole.metrics.pairs
    assert described(resumed.events) == described(whole.events)


@pytest.mark.parametrize("loss", ["mse+gram", "mse"])
@pytest.mark.parametrize("name", strategy_names())
def test_an_edit_stopped_at_any_checkpoint_ends_as_the_whole_one(request_, tmp_path, name, loss):
    strategy = short(name)
    settings = replace(SETTINGS, update=replace(SETTINGS.update, loss=loss))
    given = {"strategy": strategy, "settings": settings}
    whole = write(request_.steps(**given), tmp_path)
    states = sorted(tmp_path.iterdir())
    assert not torch.equal(whole.scene.sh, request_.scene.sh)
    middle = len(states) // 2
    for place in (0, middle, -2) if name == "single-pass" else (middle,):
        items = list(request_.steps(load_state(states[place]), **given))
        assert_same_result(items[-1], whole)
        after = [item for item in items if isinstance(item, Event)]
        assert after == list(items[-1].events[-len(after) :])
        assert "survey" not in {event.stage for event in after}


class Failing:
    """A 2D editor that fails when it is asked a second time, after drawing at chance."""

    name, cell, capabilities = "failing", 8, Capabilities()

    def __init__(self, fails: bool = True) -> None:
        self.fails, self.asked = fails, 0

    def check(self, prompt):
        pass

    def edit(self, batch, settings, generator):
        self.asked += 1
        level = torch.rand((), generator=generator)
        yield EditProgress(1, 2)
        if self.fails and self.asked == 2:
            raise RuntimeError("the network is gone")
        yield EditProgress(2, 2, level * batch.originals.flip(-1))


def test_an_editor_that_fails_loses_nothing_that_was_done(request_, tmp_path):
    """No checkpoint was due: the last one is from before the editor was asked."""
    settings = replace(SETTINGS, checkpoint_seconds=1000.0, region="all")
    with pytest.raises(RuntimeError, match="the network is gone"):
        write(request_.steps(editor=Failing(), settings=settings), tmp_path)
    (kept,) = tmp_path.iterdir()
    assert load_state(kept).record["work"]["steps"] == 12
    resumed = deque(
        request_.steps(load_state(kept), editor=Failing(False), settings=settings), 1
    ).pop()
    whole = deque(request_.steps(editor=Failing(False), settings=settings), 1).pop()
    assert_same_result(resumed, whole)


def test_another_edit_does_not_go_on(request_, tmp_path):
    state = next(i for i in request_.steps() if isinstance(i, Checkpoint)).state
    save_state(state, tmp_path / "state")
    state = load_state(tmp_path / "state")
    others = {
        "instruction is as gold, was as bronze": {"sentence": "as gold"},
        "settings.update.patches is 3, was 2": {
            "settings": replace(SETTINGS, update=replace(SETTINGS.update, patches=3))
        },
        "strategy.update_steps is 30, was 12": {"strategy": SinglePass(30)},
        "editor is failing, was closed-form": {"editor": Failing()},
        "seed is 4, was 3": {"generator": torch.Generator().manual_seed(4)},
        "views is 5 of 32x32": {"views": Dataset(request_.data.views[:5])},
    }
    for difference, change in others.items():
        with pytest.raises(UsageError, match=f"not the edit that was interrupted: {difference}"):
            next(request_.steps(state, **change))
    moved = Request(replace(request_.scene, means=request_.scene.means + 1e-6), request_.data)
    with pytest.raises(UsageError, match=r"scene is 400 Gaussians, .*, was 400 Gaussians"):
        next(moved.steps(state))
    with pytest.raises(UsageError, match="written by another version of gsedit"):
        next(request_.steps(state.along_with(edit_format=2)))
    free = replace(SETTINGS, checkpoint_seconds=9.0, held_out_edits=1)
    assert next(request_.steps(state, settings=free))


def test_a_crafted_checkpoint_is_refused_by_its_file(request_, tmp_path):
    path = tmp_path / "crafted"
    checkpoints = (item for item in request_.steps() if isinstance(item, Checkpoint))
    state = next(c.state for c in checkpoints if "optimizer.first.sh" in c.state.tensors)
    for name in ("optimizer.first.sh", f"answer.{state.record['answers'][0]}", "generator"):
        tensors = {**state.tensors, name: state.tensors[name].reshape(-1)[:0]}
        save_state(replace(state, tensors=tensors), path)
        with pytest.raises(InputError, match=f"{path} is damaged"):
            deque(request_.steps(load_state(path)))
    for changed in (
        {"targets": [-1]}, {"view_plan": {"batches": 1}}, {"work": {"steps": "x"}},
        {"stages": {"a": []}}, {"events": [{"x": 1}]},
    ):  # fmt: skip
        save_state(state.along_with(**changed), path)
        with pytest.raises(InputError, match=f"{path} is damaged"):
            deque(request_.steps(load_state(path)))


CHILD = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1], sys.argv[2]]
import test_resume
from gsedit.run.state import save_state
request = test_resume.Request(test_resume.painted(400), test_resume.seen(400, 6, 32))
for item in request.steps():
    if isinstance(item, test_resume.Checkpoint):
        save_state(item.state, Path(sys.argv[3]))
        print(item.step, flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_an_edit_goes_on_after_kill_9(request_, tmp_path):
    here = Path(__file__).parent
    state = tmp_path / "state"
    command = [sys.executable, "-c", CHILD, str(here), str(here.parents[1]), str(state)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        while int(child.stdout.readline()) < 10:
            pass
        child.send_signal(signal.SIGKILL)  # while it computes or writes
        assert child.wait() == -signal.SIGKILL
    resumed = deque(request_.steps(load_state(state)), 1).pop()
    assert_same_result(resumed, deque(request_.steps(), 1).pop())
