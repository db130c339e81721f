"""Score distillation: towards the edit, of what is seen alone, with nothing edited in 2D."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tiny_edits import SETTINGS, Watched, data, run, scene

from gsedit import edit
from gsedit.editing.session.session import MIN_SEEN_PIXELS
from gsedit.editing.strategies._random_views import correlation_loss
from gsedit.editing.strategies.sds import Sds
from gsedit.editing.view_plan import survey
from gsedit.editors.command.editor import Command
from gsedit.errors import UsageError

ALL = torch.ones(len(scene()), dtype=torch.bool)


@pytest.fixture(scope="module")
def free():
    """50 steps without the regulariser."""
    editor = Watched()
    result, events = run(Sds(total_steps=50, structure_weight=0.0), editor=editor)
    return result, events, editor.asked


def test_sds_approaches_the_truth_without_any_edited_picture(free):
    result, events, asked = free
    unedited, _ = run(Sds(total_steps=1))
    gain = result.metrics.psnr_to_ground_truth - unedited.metrics.psnr_to_ground_truth
    assert gain > 1
    assert asked == []
    assert result.targets == ()
    assert result.work.calls == 0
    assert [e.step for e in events if e.stage == "update"] == [10, 20, 30, 40, 50]


def test_sds_counts_what_its_denoiser_evaluates(free):
    result, _, _ = free
    assert result.work.steps == 50
    assert result.work.evaluations == 50 * 3  # text and image, image, neither


def test_sds_moves_what_its_views_see_and_nothing_else():
    one = replace(SETTINGS, views_per_batch=1, batches=1)
    result, _ = run(Sds(total_steps=5, dataset_views="planned"), one)
    views, _ = data().split()
    weights = survey(scene(), [views[i].camera for i in result.view_plan.views])
    moved = (result.scene.sh - scene().sh).abs().amax((1, 2)) > 0
    seen = weights.sum(0) > MIN_SEEN_PIXELS
    assert moved.any()
    assert not (moved & ~seen).any()
    assert (~seen).any()


def test_the_regulariser_keeps_the_structure(free):
    result, _, _ = free
    held, _ = run(Sds(total_steps=20, structure_weight=30.0))
    loose, tight = (correlation_loss(r.scene, scene(), ALL) for r in (result, held))
    assert tight < 0.5 * loose


def test_the_correlation_is_pearsons_and_forgives_gain_and_offset():
    whole = scene().to(torch.float64)
    hidden = torch.linspace(-2, 2, len(whole), dtype=torch.float64)
    original = replace(whole, logit_opacities=hidden)
    assert float(correlation_loss(original, original, ALL)) == pytest.approx(0, abs=1e-5)
    brighter = replace(original, sh=1.7 * original.sh + 0.2)
    assert float(correlation_loss(brighter, original, ALL)) == pytest.approx(0, abs=1e-5)
    inverted = replace(original, sh=-original.sh)
    assert float(correlation_loss(inverted, original, ALL)) == pytest.approx(2, abs=1e-5)
    flat = whole  # all opacities are equal: no structure that could be kept
    faded = replace(flat, logit_opacities=hidden)
    assert float(correlation_loss(faded, flat, ALL)) == pytest.approx(0, abs=1e-5)
    some = ALL.clone()
    some[::3] = False
    other = replace(original, sh=original.sh.flip(0), logit_opacities=original.sh[:, 0, 1].clone())
    opacities = [torch.sigmoid(s.logit_opacities[some]) for s in (other, original)]
    expected = 1 - torch.corrcoef(torch.stack(opacities))[0, 1]
    channels = [
        1 - torch.corrcoef(torch.stack((other.sh[some, 0, c], original.sh[some, 0, c])))[0, 1]
        for c in range(3)
    ]
    expected = expected + torch.stack(channels).mean()
    torch.testing.assert_close(correlation_loss(other, original, some), expected)


def test_an_editor_without_a_diffusion_model_is_refused(tmp_path):
    with pytest.raises(UsageError, match="sds needs the diffusion model of an editor"):
        edit(
            scene(),
            "as bronze",
            editor=Command("true {input} {output}", folder=tmp_path),
            dataset=data(),
            settings=replace(SETTINGS, region="all"),
            strategy=Sds(),
        )
