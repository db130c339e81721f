"""A baseline of the paper descends its loss, on a tiny scene."""

import pytest
import torch
from research.strategies.descent import correlation_loss
from research.strategies.sds import Sds
from tiny_edits import PROMPT, SETTINGS, Watched, data, run, scene

from gsedit import edit
from gsedit.errors import UsageError
from gsedit.measures.formulas import psnr
from gsedit.paper.editors.command import Command
from gsedit.paper.editors.protocol import truth_of

ALL = torch.ones(len(scene()), dtype=torch.bool)


def test_sds_approaches_the_truth_without_any_edited_picture():
    editor = Watched()
    result, events = run(Sds(50, structure_weight=0.0), editor=editor)
    before, after = (
        torch.stack([v.image for v in each]) for each in (result.originals, result.finals)
    )
    truth = truth_of(editor).find_ground_truth(PROMPT, after, before)(before)
    assert psnr(after, truth) > psnr(before, truth) + 1
    assert editor.asked == []
    assert result.targets == ()
    assert result.work.evaluations == 50 * 3  # text and image, image, neither
    assert [e.step for e in events if e.stage == "update"] == [10, 20, 30, 40, 50]
    held, _ = run(Sds(20, structure_weight=30.0))
    loose, tight = (correlation_loss(r.scene, scene(), ALL) for r in (result, held))
    assert tight < 0.5 * loose


def test_sds_needs_a_diffusion_model(tmp_path, quick_saliency):
    program = Command("true {input} {output}", folder=tmp_path)
    with pytest.raises(UsageError, match="needs a diffusion model"):
        edit(scene(), PROMPT, editor=program, views=data(), settings=SETTINGS, strategy=Sds())
