"""Examination of editors: on pictures made here, and on photos of a capture."""

from __future__ import annotations

import math

import pytest
import torch
from train_small import Case, judge, summary
from train_small.captured import Column, captured, looked_at, mean_up
from train_small.phrases import held_out_prompts
from train_small.pictures import procedural
from train_small.scoring import UNEDITED, score
from train_small.sources import FAR, Stored, store
from train_small.target_edits import TRUTHS, edited

from gsedit.diffusion import SamplerSettings
from gsedit.editors import EditProgress
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.views.dataset import capture


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def stored() -> Stored:
    return store(procedural(12, 48, seeded()))


def case(name: str, stored: Stored, count: int = 4) -> Case:
    return Case(stored[torch.arange(count)], (name,), held_out_prompts((name,))[0])


@pytest.mark.parametrize("name", ["red", "bronze", "snow", "sketch"])
def test_true_edits_are_right(stored, name):
    asked = case(name, stored)
    truth = edited(asked.sources, asked.names)
    noisy = truth + 0.001 * torch.randn(truth.shape, generator=seeded())
    found = summary(list(judge(asked, noisy)))
    assert found.nearest == 1
    assert found.gain > 20
    if TRUTHS[name].scope == "subject":
        assert found.kept is not None
        assert abs(found.kept - 60) < 1  # of noise of 0.001
    else:
        assert found.kept is None


def test_what_was_not_edited_is_wrong_and_gains_nothing(stored):
    asked = case("red", stored)
    scores = list(judge(asked, asked.sources.image))
    assert all(each.nearest == (UNEDITED,) for each in scores)
    assert all(each.gain == 0 for each in scores)
    assert summary(scores).kept == math.inf


def test_another_look_is_wrong(stored):
    asked = case("red", stored)
    scores = list(judge(asked, edited(asked.sources, ("blue",))))
    assert all(each.nearest == ("blue",) for each in scores)


def test_the_wrong_partner_is_wrong(stored):
    sources = stored[torch.arange(3)]
    asked = Case(sources, ("bronze", "night"), "")
    right = list(judge(asked, edited(sources, ("bronze", "night"))))
    wrong = list(judge(asked, edited(sources, ("gold", "night"))))
    assert all(each.right for each in right)
    assert all(each.nearest == ("gold", "night") for each in wrong)


def test_what_a_look_would_not_change_is_left_out(stored):
    sources = stored[torch.arange(3)]
    sources = sources._replace(subject=torch.zeros_like(sources.subject))
    assert not list(judge(Case(sources, ("red",), ""), sources.image))


def test_an_editor_is_examined_picture_by_picture(stored):
    class Truthful:
        name, cell = "truthful", 4

        def check(self, prompt):
            assert prompt

        def edit(self, batch, settings, generator):
            assert batch.correspondences is None
            yield EditProgress(1, 1, edited(asked.sources, ("gold",)))

    asked = case("gold", stored)
    scores = list(score(Truthful(), [asked], SamplerSettings()))
    assert len(scores) == 4
    assert all(each.right for each in scores)


def test_no_scores_have_no_summary():
    with pytest.raises(ValueError, match="no scores"):
        summary([])


@pytest.fixture(scope="module")
def demo():
    scene = demo_scene()
    gaussians = surface_gaussians(scene, 8000, seeded())
    cameras = ring_cameras(scene, 6, 64, elevation=25.0)
    return gaussians, cameras, capture(gaussians, cameras, [str(i) for i in range(6)])


def test_a_capture_says_where_it_is_looked_at_and_what_is_up(demo):
    _, cameras, _ = demo
    assert looked_at(cameras).abs().max() < 1e-6
    torch.testing.assert_close(mean_up(cameras), torch.tensor([0.0, 0.0, 1.0]).double())


def test_photos_of_a_capture_get_their_geometry(demo):
    gaussians, cameras, views = demo
    column = Column(torch.zeros(3).double(), mean_up(cameras), 0.8, -0.3)
    found = captured(gaussians, views, column)
    assert found.image.shape == (6, 64, 64, 3)
    share = float(found.subject.mean())
    assert 0.03 < share < 0.5
    inside = found.subject[..., 0] > 0
    assert abs(float(found.depth[..., 0][inside].median()) - 1) < 0.05
    exact = torch.stack([demo_scene().trace(camera).normal for camera in cameras]).float()
    seen = (exact.norm(dim=-1) > 0) & (found.depth[..., 0] < FAR)
    assert float((exact * found.normal).sum(-1)[seen].median()) > 0.9
    sky = found.depth[..., 0] == FAR
    assert sky.any()
    assert not found.normal[sky].any()
