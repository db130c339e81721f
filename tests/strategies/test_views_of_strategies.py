"""What a plan leaves out knows which views a strategy uses, and every step of its optimiser."""

from __future__ import annotations

import pytest
from tiny_edits import PROMPT, SETTINGS, Watched, data, scene

from gsedit.edit import explain
from gsedit.session.actions import OptimiserSteps
from gsedit.strategies import uses_all_views
from gsedit.strategies._distil import Distil
from gsedit.strategies.bulk import Bulk
from gsedit.strategies.iterative import Iterative
from gsedit.strategies.sds import Sds
from gsedit.strategies.single_pass import SinglePass


@pytest.mark.parametrize(
    ("strategy", "all_views"),
    [
        (SinglePass(), False),
        (Iterative(), True),
        (Iterative(dataset_views="planned"), False),
        (Bulk(), True),
        (Sds(), True),
    ],
)
def test_a_strategy_says_whether_it_needs_more_views_than_the_plan_has(strategy, all_views):
    assert uses_all_views(strategy) == all_views


def test_the_plan_leaves_no_view_out_that_the_strategy_needs():
    decisions = explain(
        scene(),
        PROMPT,
        editor=Watched(),
        dataset=data(),
        settings=SETTINGS,
        strategy=Iterative(total_steps=20),
    )
    (views,) = (decision for decision in decisions if decision.name == "views")
    assert "Needed" in str(views)


def test_steps_of_score_distillation_are_steps_of_the_optimiser():
    assert isinstance(Distil((0,), 0, 10, 30, 0.0, 0.1, 0.9), OptimiserSteps)
