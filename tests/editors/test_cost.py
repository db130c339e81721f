"""The cost of an edit is measured before it begins."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from time import sleep

import pytest
import tiny_edits
import torch

from gsedit import EditResult, Event, edit_steps
from gsedit.diffusion.guided import branches_of
from gsedit.diffusion.sampler import levels_of
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editing.edit import plan_edit
from gsedit.editor_protocol import Cost
from gsedit.editors.sampling import DiffusionEditor
from gsedit.paper.estimate import Estimate, cheaper, duration
from gsedit.paper.settings import find_preset

pytestmark = pytest.mark.usefixtures("offline")
SETTINGS = replace(
    tiny_edits.SETTINGS,
    sampler=SamplerSettings(steps=3, precision="float32"),
    held_out_edits=1,
    region="all",
)
COST = Cost(20, 60, 2.0, 5.0, 5.0, 4_000_000_000, "float32")


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
    views, conditions, first_view, two_batches = 4, 3, 1, 2 * 2
    assert result.work.evaluations == conditions * (views * 3 + first_view + two_batches)


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


def test_an_estimate_in_words():
    text = Estimate(12, 2, COST, "--preset quick").describe(datetime(2026, 1, 1, 12))
    assert text == (
        "14 views (2 of them to compare with), 20 steps of 3 branches, 2 s each in float32: about "
        "32 min, until 12:31; 4.0 GB of memory; --preset quick takes half as long or less"
    )
    assert [duration(each) for each in (40.0, 600.0, 36000.0)] == ["40 s", "10 min", "10.0 h"]


def test_the_setting_that_halves_the_time():
    levels = levels_of(Schedule.scaled_linear(), SamplerSettings())
    full, quick = (
        sum(branches_of(levels, settings))
        for settings in (SamplerSettings(), find_preset("quick").settings.sampler)
    )
    assert full == 60 >= 2 * quick
    rounded = replace(COST, precision="bfloat16")
    assert cheaper(COST) == "--preset quick"
    assert cheaper(replace(rounded, evaluations=quick)) == "--steps 10"
    assert not cheaper(replace(rounded, steps=4, evaluations=4))


def test_the_text_encoder_is_a_part_of_the_estimate(model, monkeypatch):
    """Models that read a sentence beside each picture spend nearly half of an edit on that."""
    condition = type(model).condition

    def slow(self, originals, *more):
        sleep(0.05 * len(originals))
        return condition(self, originals, *more)

    monkeypatch.setattr(type(model), "condition", slow)
    cost = plan_edit(tiny_edits.scene(), tiny_edits.PROMPT, **request(model)).estimate.cost
    assert cost.condition_s >= 0.05
    assert cost.seconds(4) > 4 * cost.condition_s
