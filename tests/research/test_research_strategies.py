"""The baselines of the paper descend their losses, on a tiny scene and a tiny random CLIP."""

import pytest
import torch
from research.strategies.clip import Clip, load_clip
from research.strategies.descent import correlation_loss
from research.strategies.sds import Sds
from tiny_edits import PROMPT, SETTINGS, Watched, data, run, scene

from gsedit import edit
from gsedit.errors import UsageError
from gsedit.measures.formulas import psnr
from gsedit.paper.editors.command.editor import Command

ALL = torch.ones(len(scene()), dtype=torch.bool)


def test_sds_approaches_the_truth_without_any_edited_picture():
    editor = Watched()
    result, events = run(Sds(50, structure_weight=0.0), editor=editor)
    before, after = (
        torch.stack([v.image for v in each]) for each in (result.originals, result.finals)
    )
    truth = editor.capabilities.find_ground_truth(PROMPT, after, before)(before)
    assert psnr(after, truth) > psnr(before, truth) + 1
    assert editor.asked == []
    assert result.targets == ()
    assert result.work.evaluations == 50 * 3  # text and image, image, neither
    assert [e.step for e in events if e.stage == "update"] == [10, 20, 30, 40, 50]
    held, _ = run(Sds(20, structure_weight=30.0))
    loose, tight = (correlation_loss(r.scene, scene(), ALL) for r in (result, held))
    assert tight < 0.5 * loose


def test_sds_needs_a_diffusion_model(tmp_path):
    program = Command("true {input} {output}", folder=tmp_path)
    with pytest.raises(UsageError, match="needs a diffusion model"):
        edit(scene(), PROMPT, editor=program, views=data(), settings=SETTINGS, strategy=Sds())


def test_clip_brings_pictures_nearer_to_the_text(tmp_path):
    from tiny_clip import write_tiny_clip

    folder = write_tiny_clip(tmp_path / "clip")
    editor = Watched()
    result, _ = run(Clip(30, structure_weight=0.0, folder=folder), editor=editor)
    clip = load_clip(folder)
    before, after = (
        (clip.images(torch.stack([v.image for v in each])) @ clip.texts([PROMPT])[0]).mean()
        for each in (result.originals, result.finals)
    )
    assert after > before
    assert editor.asked == []
    assert result.work.evaluations == 0
