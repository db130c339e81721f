"""A strategy is one file: found by its name, run by the pipeline, and free to ask as it likes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import pytest
import torch

import gsedit
from gsedit import Checkpoint, Dataset, EditSettings, Event, edit_steps
from gsedit.datasets.dataset import capture
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import make_editor
from gsedit.errors import GseditError, UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.paper import strategies
from gsedit.paper.actions import Action, Strategy, update_round
from gsedit.paper.edit_views import edit_views
from gsedit.paper.request import name_of
from gsedit.paper.session import Session, seen_gaussians
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians


@dataclass(frozen=True)
class DatasetUpdate:
    """Instruct-NeRF2NeRF's way: one view in turn, from a noise level drawn anew, a few steps."""

    edits: int = 5
    steps_between: int = 3

    def schedule(self, session: Session) -> Iterator[Action]:
        planned = session.plan.views
        total = self.edits * self.steps_between
        for number in range(self.edits):
            yield EditAtChance(planned[number % len(planned)])
            yield from update_round(
                self.steps_between, done=number * self.steps_between, total=total
            )


@dataclass(frozen=True)
class EditAtChance:
    """Edit a view from a noise level drawn anew."""

    view: int

    def __call__(self, session: Session) -> Iterator[Event]:
        draw = float(torch.rand((), generator=session.request.generator))
        noised = replace(
            session.request.settings.sampler, strength=0.3 + 0.68 * draw, consensus=False
        )
        yield from edit_views(session, [self.view], sampler=noised)


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 1000, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def data(scene):
    cameras = ring_cameras(demo_scene(), 9, 48)
    return Dataset(capture(scene, cameras, [str(i) for i in range(9)]))


def test_another_strategy_needs_nothing_but_itself(scene, data):
    settings = EditSettings(
        sampler=SamplerSettings(steps=4),
        update=UpdateSettings(patches=2, patch=16),
        views_per_batch=3,
        batches=1,
        anchors=0,
        checkpoint_seconds=0.0,
    )
    strategy = DatasetUpdate()
    items = list(
        edit_steps(
            scene,
            "as bronze",
            editor=make_editor("closed-form"),
            generator=torch.Generator().manual_seed(0),
            views=data,
            settings=settings,
            strategy=strategy,
        )
    )
    result = items[-1]
    assert result.strategy is strategy
    assert len(result.targets) == 3  # the first two were edited twice
    samples = [i for i in items if isinstance(i, Event) and i.stage == "sample"]
    assert len([e for e in samples if e.step == e.steps]) == 5
    steps = [c.step for c in items if isinstance(c, Checkpoint)]
    assert steps == [0, 3, 3, 6, 6, 9, 9, 12, 12, 15]
    done = {"actions": 10, "steps": 15, "calls": 5, "evaluations": 5 * 4 * 3}
    assert asdict(result.work).items() >= done.items()
    assert not torch.equal(result.scene.sh, scene.sh)


@dataclass(frozen=True)
class WithoutTargets:
    """Edits no 2D picture, as score distillation does."""

    def schedule(self, session: Session) -> Iterator[Action]:
        assert seen_gaussians(session).any()
        assert session.request.editor.capabilities.denoiser is not None
        return iter(())


def test_a_strategy_may_edit_no_picture(scene, data, tmp_path):
    *events, result = edit_steps(
        scene,
        "as bronze",
        editor=make_editor("closed-form"),
        generator=torch.Generator().manual_seed(0),
        views=data,
        settings=EditSettings(views_per_batch=2, batches=1),
        strategy=WithoutTargets(),
    )
    assert result.targets == ()
    assert len(result.originals) == len(result.finals) == 2
    assert result.metrics.psnr_to_targets is None
    assert result.metrics.rmse_to_unedited < 1e-6  # the same scene, drawn twice
    assert result.events == tuple(e for e in events if isinstance(e, Event))
    gsedit.write_edit(tmp_path / "out", result)
    assert (tmp_path / "out" / "edit.json").exists()


class NoRecord:
    """A strategy without fields that could be written down."""

    def schedule(self, session: Session) -> Iterator[Action]:
        return iter(())


def test_a_strategy_is_a_record_of_its_settings(scene, data):
    with pytest.raises(UsageError, match="no strategy: give an instance of a dataclass"):
        next(
            edit_steps(
                scene,
                "as bronze",
                editor=make_editor("closed-form"),
                generator=torch.Generator(),
                views=data,
                strategy=NoRecord(),
            )
        )


def test_strategies_are_found_by_the_name_of_their_file():
    assert "single-pass" in strategies.strategy_names()
    assert strategies.find_strategy("single-pass") is SinglePass
    assert name_of(SinglePass(3)) == "single-pass"
    assert isinstance(SinglePass(), Strategy)
    with pytest.raises(UsageError, match=r"no strategy 'two-pass': choose one of .*single-pass"):
        strategies.find_strategy("two-pass")


def test_a_new_file_is_a_new_strategy(monkeypatch, tmp_path):
    (tmp_path / "trial_run.py").write_text(
        "from dataclasses import dataclass\n"
        "@dataclass(frozen=True)\n"
        "class TrialRun:\n"
        "    pace: float = 2.0\n"
        "    def schedule(self, session): return iter(())\n"
    )
    (tmp_path / "ip2p_update.py").write_text("")
    (tmp_path / "_shared.py").write_text("")
    monkeypatch.setattr(strategies, "__path__", [*strategies.__path__, str(tmp_path)])
    assert "-shared" not in strategies.strategy_names()
    with pytest.raises(GseditError, match=r"ip2p_update\.py holds no dataclass Ip2pUpdate"):
        strategies.find_strategy("ip2p-update")
    assert "trial-run" in strategies.strategy_names()
    assert strategies.find_strategy("trial-run")().pace == 2.0
