"""Verdicts of the paper's experiments: every kind of result has one, and intervals hold."""

from __future__ import annotations

from math import inf, log

import pytest
import torch
from research.paper.verdicts import judge, judge_factors, verdict_of


def test_a_verdict_is_decided_by_the_interval_and_half_of_the_size():
    assert verdict_of(0.6, 0.1, 1.1, half=0.5) == "reproduced"
    assert verdict_of(0.4, 0.1, 1.1, half=0.5) == "direction only"
    assert verdict_of(0.1, -0.1, 0.3, half=0.5) == "less than half"
    assert verdict_of(0.9, -0.1, 1.9, half=0.5) == "not decided"
    assert verdict_of(-0.4, -0.7, -0.1, half=0.5) == "opposite direction only"
    assert verdict_of(-0.6, -1.1, -0.1, half=0.5) == "opposite"


def effects(*scenes, editor="one"):
    return {f"scene {k}": {editor: list(values)} for k, values in enumerate(scenes)}


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        (effects([1.0, 1.1], [0.9, 1.0], [1.1, 1.2], [1.0]), "reproduced"),
        (effects([0.2, 0.3], [0.2, 0.2], [0.3, 0.2], [0.2]), "direction only"),
        (effects([0.2, -0.3], [0.0, 0.2], [0.1, -0.2], [0.0]), "less than half"),
        (effects([-1.0, -1.1], [-0.9], [-1.1, -1.2], [-1.0]), "opposite"),
        (effects([-0.2, -0.1], [-0.2], [-0.1, -0.2], [-0.2]), "opposite direction only"),
        (effects([2.0, 2.1], [-1.9], [2.2, 2.0], [-1.0]), "not decided"),  # scenes contradict
        (effects([1.0, 1.1, 1.2, 1.0, 1.1]), "direction only"),  # one scene is never more
        (effects([-1.0, -1.1, -1.2]), "opposite direction only"),  # either way
        (effects([1.0]), "not decided"),  # nor one run anything
        ({"a": {"one": [1.0], "varied": [1.1]}}, "not decided"),  # nor one seed
    ],
)
def test_every_kind_of_result_has_its_verdict(found, verdict):
    judged = judge(found, half=0.5)
    assert judged is not None
    assert judged.verdict == verdict
    assert judged.low <= judged.effect <= judged.high


def test_an_interval_is_students():
    judged = judge(effects([1.0], [2.0], [3.0]), 0.5)
    width = 4.303 / 3**0.5
    assert (judged.low, judged.high) == pytest.approx((2 - width, 2 + width), abs=1e-3)


def test_the_interval_of_several_editors_covers_their_mean():
    """An editor with a single scene keeps its weight: the interval is of one quantity."""
    random = torch.Generator().manual_seed(0)
    covered = 0
    for _ in range(1000):
        away = torch.randn(3, 6, generator=random).tolist()
        found = {
            f"scene {k}": {
                "closed-form": [2.0 + away[0][k]] if k < 3 else [],
                "varied": [0.0 + away[1][k]],
                "third": [-1.0 + 0.1 * x for x in away[2]] if k == 0 else [],
            }
            for k in range(6)
        }
        judged = judge(found, 0.5)
        covered += judged.low <= (2 + 0 - 1) / 3 <= judged.high
    assert 920 < covered < 980


def test_factors_are_judged_by_their_order_alone():
    logs = [-inf, log(2), log(3), log(4), log(5), log(900)]
    judged = judge_factors(effects(*[[x] for x in logs]), log(5))
    assert (judged.effect, judged.low, judged.high) == (pytest.approx(log(12) / 2), -inf, log(900))
    assert judged.verdict == "not decided"
    assert not judge_factors(effects(*[[x] for x in logs[1:]]), log(5)).has_interval  # five
    ten = judge_factors(effects(*[[log(x)] for x in (1.1, 6, 6, 7, 7, 8, 8, 9, 9, 90)]), log(5))
    assert (ten.low, ten.high, ten.verdict) == (log(6), log(9), "reproduced")


@pytest.mark.parametrize(
    ("factors", "verdict"),
    [
        ([0, 0, 0, 0, 0, 0], "not reached"),
        ([0, 0, 0], "not reached"),  # of few runs too, if none got there
        ([0, 0, 0, 0, 0, 0, 0.1, 0.2], "not reached"),  # the slow ones are few
        ([0, 0, 0, 0, 0, 30], "not decided"),
        ([0, 0, 30], "not decided"),
        ([0, 0.1, 0.1, 0.1, 0.1, 0.1], "opposite"),  # most got there, and later
    ],
)
def test_opposite_is_said_of_what_was_seen(factors, verdict):
    logs = [[log(factor) if factor else -inf] for factor in factors]
    assert judge_factors(effects(*logs), log(5)).verdict == verdict
