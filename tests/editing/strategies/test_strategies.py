"""A strategy is one file: found by its name, run by the pipeline, and free to ask as it likes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import pytest
import torch
from tiny_edits import data, scene, steps

from gsedit import Checkpoint, EditSettings, Event
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import UsageError
from gsedit.paper import strategies
from gsedit.paper.actions import Action, Strategy, update_round
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.edit_views import edit_views
from gsedit.paper.request import name_of
from gsedit.paper.session import Session
from gsedit.paper.strategies.single_pass import SinglePass


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


def test_another_strategy_needs_nothing_but_itself():
    settings = EditSettings(
        sampler=SamplerSettings(steps=4),
        update=UpdateSettings(patches=2, patch=16),
        views_per_batch=3,
        batches=1,
        anchors=0,
        checkpoint_seconds=0.0,
    )
    strategy = DatasetUpdate()
    items = steps(scene(), data(), settings, strategy)
    result = items[-1]
    assert result.strategy is strategy
    assert len(result.targets) == 3  # the first two were edited twice
    samples = [i for i in items if isinstance(i, Event) and i.stage == "sample"]
    assert len([e for e in samples if e.step == e.steps]) == 5
    kept = [c for c in items if isinstance(c, Checkpoint)]
    assert torch.equal(kept[-1].scene.sh, result.scene.sh)
    assert [c.step for c in kept] == [0, 3, 3, 6, 6, 9, 9, 12, 12, 15]
    done = {"actions": 10, "steps": 15, "calls": 5, "evaluations": 5 * 4 * 3}
    assert asdict(result.work).items() >= done.items()
    assert not torch.equal(result.scene.sh, scene().sh)


def test_strategies_are_found_by_the_name_of_their_file():
    assert "single-pass" in strategies.strategy_names()
    assert strategies.find_strategy("single-pass") is SinglePass
    assert name_of(SinglePass(3)) == "single-pass"
    assert isinstance(SinglePass(), Strategy)
    with pytest.raises(UsageError, match=r"no strategy 'two-pass': choose one of .*single-pass"):
        strategies.find_strategy("two-pass")
