"""NeRF-Art's losses through CLIP, as a strategy: on a tiny random model."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from command_line import gsedit, one_line
from tiny_edits import SETTINGS, Watched, data, run, scene

from gsedit import Checkpoint, edit_steps
from gsedit.editing.session.session import MIN_SEEN_PIXELS
from gsedit.editing.strategies._clip_losses import clip_losses
from gsedit.editing.strategies.clip import Clip
from gsedit.editing.view_plan import survey
from gsedit.errors import InputError, UsageError
from gsedit.measures.clip import load_clip
from gsedit.runs.state import load_state, save_state

pytest.importorskip("diffusers")

SOURCE, TARGET = "a bear", "a bronze bear at sea"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    from tiny_clip import write_tiny_clip

    return write_tiny_clip(tmp_path_factory.mktemp("weights") / "clip")


@pytest.fixture(scope="module")
def descended(folder):
    """30 steps without the regulariser, on the planned views."""
    strategy = Clip(
        folder, SOURCE, TARGET, unlike="a ship; a sea", total_steps=30, local_patches=2,
        structure_weight=0.0, dataset_views="planned",
    )  # fmt: skip
    return run(strategy, replace(SETTINGS, views_per_batch=1))


def losses(folder, **weights):
    values = {"global_weight": 0.2, "local_weight": 0.1, "patches": 2, **weights}
    return clip_losses(load_clip(folder), TARGET, SOURCE, ["a ship"], **values)


def views_loss(found, folder):
    """The losses of a scene at the edited views, with the same patches each time."""
    measured = losses(folder)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        before = [measured.clip.images(v.image[None])[0] for v in found.originals]
        return sum(
            float(measured(view.image, vector, generator))
            for view, vector in zip(found.finals, before)
        ) / len(before)


def test_the_loss_falls_and_the_text_comes_nearer(descended, folder):
    result, events = descended
    same = replace(result, finals=result.originals)
    assert views_loss(result, folder) < views_loss(same, folder) - 0.1
    assert [e.step for e in events if e.stage == "update"] == [10, 20, 30]
    assert result.work.steps == 30
    assert result.work.calls == result.work.evaluations == 0
    assert result.targets == ()


def test_only_what_the_views_see_moves_and_all_is_finite(descended):
    result, _ = descended
    views, _ = data().split()
    weights = survey(scene(), [views[i].camera for i in result.view_plan.views])
    seen = weights.sum(0) > MIN_SEEN_PIXELS
    moved = (result.scene.sh - scene().sh).abs().amax((1, 2)) > 0
    assert moved.any()
    assert (~seen).any()
    assert not (moved & ~seen).any()
    assert result.scene.sh.isfinite().all()
    assert result.scene.logit_opacities.isfinite().all()


def test_the_losses_are_those_of_the_paper(folder):
    """From the vectors: a direction that is reached costs nothing, a contrast is InfoNCE."""
    measured = losses(folder, global_weight=0.0, local_weight=0.0)
    image = torch.rand(32, 32, 3, generator=torch.Generator().manual_seed(0))
    vector = measured.clip.images(image[None])[0]
    generator = torch.Generator().manual_seed(0)
    towards = measured.target - measured.source
    assert float(measured(image, vector - 0.1 * towards, generator)) == pytest.approx(0, abs=1e-5)
    assert float(measured(image, vector + 0.1 * towards, generator)) == pytest.approx(2, abs=1e-5)
    cosines = torch.stack([measured.target, *measured.negatives]) @ vector
    scaled = (cosines / 0.07).exp()
    expected = -(scaled[0] / scaled.sum()).log()
    assert float(measured.contrast(vector[None])) == pytest.approx(float(expected), rel=1e-4)
    assert len(measured.negatives) == 2  # the source is one


def test_weights_that_are_not_there_are_asked_for_before_any_work(tmp_path):
    with pytest.raises(UsageError, match="needs the weights of CLIP: add --clip DIR"):
        run(Clip())
    with pytest.raises(InputError, match="is no folder"):
        run(Clip(tmp_path / "gone"))
    with pytest.raises(UsageError, match="local patches must be 1 or more"):
        Clip(local_patches=0)
    with pytest.raises(UsageError, match=r"global weight -1.0 is not 0 or more"):
        Clip(global_weight=-1.0)
    done = gsedit("edit", "x.ply", "a hat", "-o", tmp_path / "out", "--strategy", "clip")
    assert done.exit_code == 2
    assert "add --clip DIR" in done.stderr
    assert one_line(done.stderr)


def test_any_instruction_will_do(folder):
    """`closed-form` knows no hats; nobody can say where one belongs, so the region is all."""
    *_, result = edit_steps(
        scene(), "give it a hat", editor=Watched(), generator=torch.Generator().manual_seed(0),
        dataset=data(), settings=SETTINGS, strategy=Clip(folder, total_steps=1),
    )  # fmt: skip
    assert result.region.is_all
    assert result.metrics.rmse_to_unedited > 0


def test_a_descent_that_was_interrupted_ends_as_the_whole_one(folder, tmp_path):
    def steps(resume=None):
        return edit_steps(
            scene(), "a hat", editor=Watched(), generator=torch.Generator().manual_seed(3),
            dataset=data(), settings=replace(SETTINGS, checkpoint_seconds=0.0),
            strategy=Clip(folder, SOURCE, total_steps=12, local_patches=1), resume=resume,
        )  # fmt: skip

    whole, states = None, []
    for whole in steps():
        if isinstance(whole, Checkpoint):
            states.append(tmp_path / f"{len(states)}.state")
            save_state(whole.state, states[-1])
    *_, resumed = steps(load_state(states[0]))
    assert resumed.work.steps == whole.work.steps == 12
    torch.testing.assert_close(resumed.scene.sh, whole.scene.sh, rtol=1e-5, atol=1e-6)
