"""Iterative and combined: when the 2D editor is asked, for which views, and from where."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import pytest
import torch
from tiny_edits import SETTINGS, Watched, data
from tiny_edits import run as run_tiny

from gsedit import Event
from gsedit.diffusion.settings import SamplerSettings
from gsedit.errors import UsageError
from gsedit.paper.strategies._dataset import alone
from gsedit.paper.strategies.combined import Combined
from gsedit.paper.strategies.iterative import Iterative
from gsedit.paper.strategies.single_pass import SinglePass

STEPPED = replace(SETTINGS, update=replace(SETTINGS.update, loss="mse+gram"))
"""Settings by which the scene is fitted in steps."""
EDITABLE = data().split()[0]


def run(strategy, settings=STEPPED, editor=None):
    """The result and the events of an edit; its scene is fitted in steps."""
    return run_tiny(strategy, settings, editor)


def order(events: list[Event]) -> list[str]:
    """The stages of asking and of fitting, one a stretch."""
    stages = [e.stage for e in events if e.stage in ("sample", "update")]
    return [stage for stage, _ in groupby(stages)]


@pytest.fixture(scope="module")
def iterative():
    """10 edits, 10 steps after each."""
    editor = Watched()
    result, events = run(Iterative(total_steps=100), editor=editor)
    return result, events, editor.asked


def test_iterative_asks_for_one_view_every_few_steps(iterative):
    result, events, asked = iterative
    assert result.work.steps == 100
    assert result.work.calls == len(asked) == 10
    assert order(events) == ["sample", "update"] * 10
    for batch, settings in asked:
        assert batch.images.shape == (1, *EDITABLE[0].image.shape)
        assert batch.correspondences is None
        assert not settings.consensus


def test_iterative_approaches_the_truth(iterative):
    _, events, _ = iterative
    middle, end = (e.error for e in events if e.stage == "update" and e.error is not None)
    unedited, _ = run(Iterative(total_steps=1))
    assert end < middle < 10 ** (-unedited.metrics.psnr_to_ground_truth / 20)
    assert end < 0.75 * 10 ** (-unedited.metrics.psnr_to_ground_truth / 20)


def test_iterative_starts_from_the_scene_as_it_is_at_any_noise_level(iterative):
    _, _, asked = iterative
    strengths = [settings.strength for _, settings in asked]
    assert len(set(strengths)) == len(strengths)
    assert min(strengths) >= 0.02
    assert max(strengths) <= 0.98
    assert max(strengths) - min(strengths) > 0.5
    first, *_, last = (batch for batch, _ in asked)
    torch.testing.assert_close(first.images, first.originals)
    assert (last.images - last.originals).square().mean().sqrt() > 0.02


def test_iterative_takes_views_in_turn_and_shows_their_unedited_pictures(iterative):
    _, _, asked = iterative
    shown = [batch.originals.numpy().tobytes() for batch, _ in asked]
    turn = len(EDITABLE)
    assert len(set(shown)) == turn
    assert shown[turn:] == shown[:-turn]


def test_the_dataset_of_iterative_holds_unedited_pictures_until_they_are_edited():
    strategy = Iterative(total_steps=20, steps_between=10)
    result, _ = run(strategy)
    assert len(result.targets) == len(EDITABLE)
    changed = [
        not torch.equal(target.image, original.image)
        for target, original in zip(result.targets, result.originals)
    ]
    assert sum(changed) == 2
    planned, _ = run(Iterative(total_steps=10, dataset_views="planned"))
    assert {v.name for v in planned.targets} == {EDITABLE[i].name for i in planned.view_plan.views}


def test_combined_is_the_single_pass_and_then_the_iterative_update():
    editor, alone = Watched(), Watched()
    strategy = Combined(update_steps=10, further_steps=30, dataset_views="planned")
    result, events = run(strategy, editor=editor)
    single, _ = run(SinglePass(10), editor=alone)
    batches = len(single.view_plan.batches)
    for (a, _), (b, _) in zip(editor.asked, alone.asked):
        torch.testing.assert_close(a.images, b.images)
    assert len(editor.asked) == batches + 3
    assert result.work.steps == 10 * batches + 30
    assert order(events) == ["sample", "update"] * (batches + 3)
    assert [e.step for e in events if e.stage == "update"][-1] == result.work.steps
    start = editor.asked[batches][0]  # from the scene that the single pass made
    assert (start.images - start.originals).square().mean().sqrt() > 0.02


def test_the_dataset_of_combined_holds_no_unedited_picture():
    result, _ = run(Combined(update_steps=3, further_steps=10))
    for target, original in zip(result.targets, result.originals):
        assert not torch.equal(target.image, original.image)


def test_a_low_noise_level_takes_as_many_steps_as_it_has_levels():
    settings = replace(SETTINGS, sampler=SamplerSettings(steps=100))
    editor = Watched()
    run(Iterative(total_steps=1, least_noise=0.02, most_noise=0.03), settings, editor)
    ((_, asked),) = editor.asked
    assert 20 <= asked.step_count <= 30


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Iterative(total_steps=0),
        lambda: Iterative(least_noise=0.5, most_noise=0.4),
        lambda: Combined(further_steps=0),
        lambda: Combined(most_noise=1.5),
    ],
)
def test_values_out_of_range_are_refused(wrong):
    with pytest.raises(UsageError):
        wrong()


def test_a_view_on_its_own_has_the_editors_steps_where_none_are_given():
    settings = SamplerSettings()
    assert alone(settings, 0.5).steps is None
    assert alone(settings, 0.005).steps == 5
    assert alone(replace(settings, steps=30), 0.5).steps == 30
