"""The cost of an edit is measured before it begins."""

from __future__ import annotations

from dataclasses import replace

import pytest
import tiny_edits
import torch

from gsedit import EditResult, Event, edit_steps
from gsedit.editing.edit import plan_edit
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.sampling import DiffusionEditor

pytestmark = pytest.mark.usefixtures("offline")
SETTINGS = replace(
    tiny_edits.SETTINGS,
    sampler=SamplerSettings(steps=3, precision="float32"),
    held_out_edits=1,
    region="all",
)


def request(model) -> dict:
    return {
        "editor": DiffusionEditor(model),
        "generator": torch.Generator().manual_seed(0),
        "views": tiny_edits.data(),
        "settings": SETTINGS,
    }


def test_an_edit_says_first_what_it_will_take(model):
    items = list(edit_steps(tiny_edits.scene(), tiny_edits.PROMPT, **request(model)))
    events = [item for item in items if isinstance(item, Event)]
    stages = [event.stage for event in events]
    assert stages.index("estimate") < stages.index("sample")
    (note,) = (event.note for event in events if event.stage == "estimate")
    assert "6 views (2 of them to compare with), 3 steps of 3 branches" in note
    (result,) = (item for item in items if isinstance(item, EditResult))
    views, conditions, two_batches = 4, 3, 2 * 2
    assert result.work.evaluations == conditions * (views * 3 + two_batches)


def test_planning_edits_nothing_and_is_right_about_the_work(model):
    given = request(model)
    state = given["generator"].get_state()
    plan = plan_edit(tiny_edits.scene(), tiny_edits.PROMPT, **given)
    assert plan.decisions
    assert plan.estimate is not None
    assert plan.estimate.cost.evaluations == 9
    assert plan.estimate.cost.peak_bytes > 1e8
    assert plan.estimate.seconds > 0
    again = request(model)["generator"]
    assert torch.equal(again.get_state(), state)
