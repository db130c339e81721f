"""Iterative and combined: when the 2D editor is asked, for which views, and from where."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import pytest
import torch
from tiny_edits import SETTINGS, Watched, data, run

from gsedit import Event
from gsedit.paper.strategies.combined import Combined
from gsedit.paper.strategies.iterative import Iterative
from gsedit.paper.strategies.single_pass import SinglePass

STEPPED = replace(SETTINGS, update=replace(SETTINGS.update, loss="mse+gram"))
"""Settings by which the scene is fitted in steps."""
EDITABLE = data().split()[0]


def order(events: list[Event]) -> list[str]:
    """The stages of asking and of fitting, one a stretch."""
    stages = [e.stage for e in events if e.stage in ("sample", "update")]
    return [stage for stage, _ in groupby(stages)]


@pytest.fixture(scope="module")
def iterative():
    """10 edits, 10 steps after each."""
    editor = Watched()
    result, events = run(Iterative(total_steps=100), STEPPED, editor)
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
    unedited, _ = run(Iterative(total_steps=1), STEPPED)
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


def test_combined_is_the_single_pass_and_then_the_iterative_update():
    editor, alone = Watched(), Watched()
    strategy = Combined(update_steps=10, further_steps=30, dataset_views="planned")
    result, events = run(strategy, STEPPED, editor)
    single, _ = run(SinglePass(10), STEPPED, alone)
    batches = len(single.view_plan.batches)
    for (a, _), (b, _) in zip(editor.asked, alone.asked):
        torch.testing.assert_close(a.images, b.images)
    assert len(editor.asked) == batches + 3
    assert result.work.steps == 10 * batches + 30
    assert order(events) == ["sample", "update"] * (batches + 3)
    assert [e.step for e in events if e.stage == "update"][-1] == result.work.steps
    start = editor.asked[batches][0]  # from the scene that the single pass made
    assert (start.images - start.originals).square().mean().sqrt() > 0.02
