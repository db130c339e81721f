"""The method as printed: its preset, views at random, and batches that are not tied together."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch
from gsedit_cli.verbs.list import preset_values
from three_scenes import Swapped
from tiny_edits import data, scene, steps

from gsedit import EditSettings
from gsedit.errors import UsageError
from gsedit.paper.settings import PRESETS
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.paper.view_plan import random_plan

PAGE = Path(__file__).parents[3] / "docs" / "concepts" / "differences.md"


def test_the_preset_is_the_papers_table():
    table = re.findall(r"^\| `([a-z_.]+)=(\S*)` \|", PAGE.read_text(), re.MULTILINE)
    sets = preset_values(PRESETS["paper"])
    assert {name: str(value) for name, value in sets.items()} == dict(table)


class Watched(Swapped):
    """An editor that keeps the batches that it was given."""

    def __init__(self) -> None:
        self.tied: list[int] = []

    def edit(self, batch, settings, generator):
        self.tied.append(int(batch.anchored.sum()))
        yield from super().edit(batch, settings, generator)


@pytest.mark.parametrize(("anchors", "tied"), [(0, [0, 0]), (1, [0, 1])])
def test_batches_are_tied_by_anchors_alone(anchors, tied):
    settings = EditSettings(
        batches=2, coverage=1.0, region="all", held_out_edits=0, anchors=anchors
    )
    editor = Watched()
    *_, result = steps(scene(), data(), settings, SinglePass(update_steps=1), editor)
    assert editor.tied == tied
    batches = [{view.name for view in result.targets[k : k + 3]} for k in (0, 3)]
    pairs = [{a, b} for a, b, _ in result.metrics.pairs]
    across = [pair for pair in pairs if not any(pair <= batch for batch in batches)]
    assert len(across) == 3 * anchors
    with pytest.raises(UsageError, match="anchors"):
        EditSettings(anchors=-1)


def test_views_at_random_are_none_twice_and_follow_the_seed():
    weights = torch.rand(10, 30, generator=torch.Generator().manual_seed(0))
    plan = random_plan(weights, 4, 9, seed=1)
    assert sorted(plan.views) == list(range(10))
    assert [len(batch) for batch in plan.batches] == [4, 4, 2]
    assert plan.coverage[-1] == pytest.approx(1)
    assert random_plan(weights, 4, 2, seed=1).batches == plan.batches[:2]
    assert random_plan(weights, 4, 2, seed=2).batches != plan.batches[:2]
