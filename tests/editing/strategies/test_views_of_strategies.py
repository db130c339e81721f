"""The decision to skip views knows which views a strategy uses."""

from __future__ import annotations

import pytest
from tiny_edits import PROMPT, SETTINGS, Watched, data, scene

from gsedit.editing.edit import plan_edit
from gsedit.paper.request import uses_all_views
from gsedit.paper.strategies.iterative import Iterative
from gsedit.paper.strategies.single_pass import SinglePass


@pytest.mark.parametrize(
    ("strategy", "all_views"),
    [
        (SinglePass(), False),
        (Iterative(), True),
        (Iterative(dataset_views="planned"), False),
    ],
)
def test_a_strategy_says_whether_it_needs_more_views_than_the_plan_has(strategy, all_views):
    assert uses_all_views(strategy) == all_views


def test_no_view_is_skipped_that_the_strategy_needs():
    decisions = plan_edit(
        scene(),
        PROMPT,
        editor=Watched(),
        views=data(),
        settings=SETTINGS,
        strategy=Iterative(total_steps=20),
    ).decisions
    (views,) = (decision for decision in decisions if decision.name == "views")
    assert "Needed" in str(views)
