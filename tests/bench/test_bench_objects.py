"""The benchmark of objects: its cases and its measures."""

import numpy as np
import pytest
from bench.object_cases import CASES, Case
from bench.objects import METHODS, given_of, scores
from bench.staged import stage

from gsedit.measures.formulas import NEAREST

REMOVAL = next(case for case in CASES if case.name == "removal-glimpse")


def test_cases_have_names_of_their_own_and_things_that_exist():
    assert len({case.name for case in CASES}) == len(CASES)
    assert {case.task for case in CASES} == set(METHODS)
    for case in CASES:
        stage(case.stage).thing(case.subject)


def test_the_truth_is_nearest_and_what_removes_nothing_is_not():
    given = given_of(REMOVAL, 2000, 32)
    assert 0 < given.inside.sum() < len(given.scene)
    right = scores(given, given.truth, 32)
    assert right["changed"] == right["hole"] == right["unseen"] == NEAREST
    nothing = scores(given, given.scene, 32)
    assert nothing["outside"] == NEAREST
    assert nothing["hole"] < 25
    assert scores(given, METHODS["removal"](given), 32)["hole"] > nothing["hole"]


@pytest.mark.parametrize("task", ["insertion", "move"])
def test_the_truth_has_the_thing_where_the_case_says(task):
    case = next(each for each in CASES if each.task == task)
    foot = case.after().thing(case.subject).foot
    if task == "move":
        assert np.allclose(foot, case.change["to"], atol=1e-9)
    given = given_of(case, 2000, 24)
    low = given.truth.means[-100:, 2].min()  # what was added stands last
    assert abs(float(low) - foot[2]) < 0.1
    assert Case("removal", "wall", "blue crate").after().things == ()
