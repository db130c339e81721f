"""An edit ends where its known answer is, leaves alone what it did not see, and can be followed."""

from dataclasses import replace

import pytest
import tiny_edits
import torch
from small_scenes import scenes
from three_scenes import Swapped
from tiny_edits import painted, seen

import gsedit
from gsedit import Dataset, EditResult, EditSettings, Event
from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import make_editor
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.dataset import capture
from rasterizer import concatenate

PROMPT = "turn the bear into a bronze statue"
SMALL = EditSettings(
    update=UpdateSettings(patches=3, patch=32), views_per_batch=3, batches=2, region="all"
)
STEPPED = replace(SMALL, update=replace(SMALL.update, loss="mse+gram"))
"""By these settings the scene is fitted in steps."""


@pytest.fixture(scope="module")
def scene():
    return painted(3000)


@pytest.fixture(scope="module")
def data():
    return seen(3000, 16, 64)


def run(scene, data, editor, settings=SMALL, seed=0, prompt=PROMPT, steps=20):
    return tiny_edits.steps(scene, data, settings, SinglePass(steps), editor, prompt, seed)


def test_an_edit_moves_the_scene_to_the_known_answer(scene, data):
    items = run(scene, data, Swapped())
    result = items[-1]
    assert isinstance(result, EditResult)
    measured = [e.error for e in items if isinstance(e, Event) and e.error is not None]
    assert measured[-1] == pytest.approx(10 ** (-result.metrics.psnr_to_ground_truth / 20))
    before = capture(scene, [v.camera for v in data.views[::8]], ["a", "b"])
    unedited = [(v.image - v.image.flip(-1)).square().mean() for v in before]
    assert measured[-1] < 0.8 * torch.stack(unedited).mean().sqrt()
    assert (
        result.metrics.rmse_to_unedited > 0.02
    )  # of the 0.13 that lie between the pictures and their true edits
    # the same cameras three times
    assert [v.name for v in result.originals] == [v.name for v in result.targets]
    assert [v.name for v in result.finals] == [v.name for v in result.targets]
    assert len(result.targets) == len(result.view_plan.views) == 6
    assert {"survey", "correspond", "sample", "update", "measure", "total"} <= set(result.timings)


def test_later_batches_are_anchored_by_finished_views_as_they_are(scene, data):
    editor = Swapped()
    result = run(scene, data, editor, replace(SMALL, held_out_edits=0))[-1]
    batch = editor.batch
    assert batch.anchored.tolist() == [False] * 3 + [True] * (len(batch.anchored) - 3)
    assert batch.anchored.any()
    finished = torch.stack([v.image for v in result.targets[:3]])
    anchors = batch.images[batch.anchored]
    for image in anchors:
        assert min(float((image - f).abs().max()) for f in finished) == 0


def test_what_no_edited_view_sees_does_not_move(scene, data):
    solid = scenes()[0]  # a closed ball
    ball = surface_gaussians(solid, 3000, torch.Generator().manual_seed(0))
    some = ball[:20]
    shells = [
        replace(ball, means=ball.means * r) for r in (1.0, 0.95, 0.9)
    ]  # nothing shines through
    inside = replace(some, means=some.means * 0.2, log_scales=some.log_scales - 2)
    far = replace(some, means=some.means + 500.0)
    whole = concatenate(*shells, inside, far)
    cameras = ring_cameras(solid, 16, 64)
    views = Dataset(capture(whole, cameras, [f"{i:02d}" for i in range(16)]))
    result = run(whole, views, Swapped(), replace(SMALL, geometry="full"))[-1]
    for name in ("means", "sh", "logit_opacities", "log_scales", "quats"):
        assert torch.equal(getattr(result.scene, name)[-40:], getattr(whole, name)[-40:])
    assert not torch.equal(result.scene.sh[:3000], whole.sh[:3000])


def test_cameras_that_see_nothing_of_the_scene_are_refused(scene, data):
    elsewhere = replace(scene, means=scene.means + 1000.0)
    with pytest.raises(UsageError, match="same frame"):
        run(elsewhere, data, Swapped())


def test_one_view_can_be_edited_alone(scene, data):
    quick = replace(SMALL, views_per_batch=1, batches=1)
    result = run(scene, Dataset(data.views[:1]), make_editor("closed-form"), quick, steps=2)[-1]
    assert result.metrics.matched is None
    assert result.metrics.psnr_to_ground_truth is None
    assert len(result.targets) == 1


def test_appearance_leaves_geometry_alone_and_full_does_not(scene, data):
    quick = replace(SMALL, batches=1)
    still = run(scene, data, Swapped(), quick, steps=3)[-1].scene
    moved = run(scene, data, Swapped(), replace(quick, geometry="full"), steps=3)[-1].scene
    for name in ("means", "quats", "log_scales"):
        assert torch.equal(getattr(still, name), getattr(scene, name))
        assert not torch.equal(getattr(moved, name), getattr(scene, name))


def test_the_closed_form_edit_agrees_and_beats_views_that_share_nothing(scene, data):
    nothing = SamplerSettings(consensus=False, noise="independent")
    alone = replace(STEPPED, sampler=nothing)
    together, apart = (
        run(scene, data, make_editor("closed-form"), chosen, steps=40)[-1].metrics
        for chosen in (STEPPED, alone)
    )
    assert together.psnr_to_ground_truth > apart.psnr_to_ground_truth + 2


def test_photos_can_be_the_condition(scene, data):
    grey = Dataset(tuple(replace(v, image=torch.full_like(v.image, 0.5)) for v in data.views))
    editor = Swapped()
    quick = replace(SMALL, batches=1)
    run(scene, grey, editor, replace(quick, condition="photo"), steps=1)
    assert (editor.batch.originals == 0.5).all()
    run(scene, grey, editor, quick, steps=1)
    assert (editor.batch.originals != 0.5).any()


def test_requests_that_cannot_be_met_are_refused_before_any_work(scene, data):
    with pytest.raises(UsageError, match="bronze"):
        run(scene, data, make_editor("closed-form"), prompt="qwertyuiop")
    with pytest.raises(UsageError, match="empty"):
        run(scene[:0], data, make_editor("closed-form"))
    with pytest.raises(UsageError, match="coverage"):
        EditSettings(coverage=0.0)
    for wrong in ({"patches": 0}, {"patch": 4}, {"loss": "mse+-1*gram"}):
        with pytest.raises(UsageError):
            UpdateSettings(**wrong)
    with pytest.raises(UsageError, match="update steps"):
        SinglePass(0)
    with pytest.raises(UsageError, match=r"SinglePass\(\)"):
        gsedit.edit(scene, "as a woodcut", views=data, strategy=SinglePass)
