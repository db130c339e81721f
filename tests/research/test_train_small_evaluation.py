"""Scores of editors: which target edit is nearest, and what is kept."""

from __future__ import annotations

import math

import pytest
import torch
from research.train_small.evaluation import UNEDITED, Case, evaluate, scores_of, summary
from research.train_small.pictures import procedural
from research.train_small.prompts import held_out_prompts
from research.train_small.sources import PackedSources, pack
from research.train_small.target_edits import TARGET_EDITS, target_images

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import Capabilities, EditProgress


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def pictures() -> PackedSources:
    return pack(procedural(12, 48, seeded()))


def case_of(name: str, pictures: PackedSources, count: int = 4) -> Case:
    return Case(pictures[torch.arange(count)], (name,), held_out_prompts((name,))[0])


@pytest.mark.parametrize("name", ["red", "bronze", "snow", "sketch"])
def test_target_edits_are_correct(pictures, name):
    case = case_of(name, pictures)
    targets = target_images(case.sources, case.names)
    noisy = targets + 0.001 * torch.randn(targets.shape, generator=seeded())
    mean = summary(list(scores_of(case, noisy)))
    assert mean.nearest == 1
    assert mean.gain > 20
    if TARGET_EDITS[name].scope == "subject":
        assert mean.kept is not None
        assert abs(mean.kept - 60) < 1  # of noise of 0.001
    else:
        assert mean.kept is None


def test_an_unedited_picture_is_wrong_and_has_no_gain(pictures):
    case = case_of("red", pictures)
    scores = list(scores_of(case, case.sources.image))
    assert all(each.nearest == (UNEDITED,) for each in scores)
    assert all(each.gain == 0 for each in scores)
    assert summary(scores).kept == math.inf


def test_another_look_is_wrong(pictures):
    case = case_of("red", pictures)
    scores = list(scores_of(case, target_images(case.sources, ("blue",))))
    assert all(each.nearest == ("blue",) for each in scores)


def test_a_pair_with_one_other_look_is_wrong(pictures):
    sources = pictures[torch.arange(3)]
    case = Case(sources, ("bronze", "night"), "")
    right = list(scores_of(case, target_images(sources, ("bronze", "night"))))
    wrong = list(scores_of(case, target_images(sources, ("gold", "night"))))
    assert all(each.correct for each in right)
    assert all(each.nearest == ("gold", "night") for each in wrong)


def test_pictures_that_a_look_does_not_change_are_left_out(pictures):
    sources = pictures[torch.arange(3)]
    sources = sources._replace(subject=torch.zeros_like(sources.subject))
    assert not list(scores_of(Case(sources, ("red",), ""), sources.image))


def test_an_editor_is_scored_picture_by_picture(pictures):
    class Exact:
        name, cell, capabilities = "exact", 4, Capabilities()

        def check(self, prompt):
            assert prompt

        def edit(self, batch, settings, generator):
            assert batch.correspondences is None
            yield EditProgress(1, 1, target_images(case.sources, ("gold",)))

    case = case_of("gold", pictures)
    scores = list(evaluate(Exact(), [case], SamplerSettings()))
    assert len(scores) == 4
    assert all(each.correct for each in scores)


def test_no_scores_have_no_summary():
    with pytest.raises(ValueError, match="no scores"):
        summary([])
