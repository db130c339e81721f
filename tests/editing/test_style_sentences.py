"""Painting styles: each is drawn by the painter in the part of the scene that it is said of."""

from dataclasses import replace

import pytest
import tiny_edits
import torch

import gsedit
from gsedit.capture.fitting.optimizer import optimized_scene
from gsedit.editing import grain
from gsedit.editing.edit import prepare
from gsedit.editing.plan import read_steps, steps_of
from gsedit.editing.preview import drawn_region, preview_edited
from gsedit.errors import UsageError
from gsedit.paper.editors import make_editor
from gsedit.paper.settings import EditSettings
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.paper.view_plan import survey
from gsedit.select.finder import Finder, Names
from gsedit.select.saved import save_named
from gsedit.views.viewpoints import viewpoints_of
from gsedit.words.read import read_instruction
from rasterizer.render import render_picture

BROAD = EditSettings(brush=6.0)  # views of 64 pixels


@pytest.fixture
def half():
    """A scene, and the region that is one half of it."""
    scene = tiny_edits.scene()
    return scene, scene.means[:, 0] > scene.means[:, 0].median()


@pytest.fixture
def named(half, tmp_path):
    """The blob is one half, the zog the other."""
    scene, inside = half
    half_of, at = {"blob": inside, "zog": ~inside}, (scene.means.numpy(), tmp_path / "scene.ply")
    return Names({name: save_named(v.numpy(), *at, name) for name, v in half_of.items()})


@pytest.mark.parametrize(
    ("sentence", "inner", "outer"),
    [
        ("paint the blob like a woodcut", True, False),
        ("paint everything except the blob like a woodcut", False, True),
        ("the blob as an oil painting, then make the blob darker", True, False),
        ("paint the blob but not the zog like a woodcut", True, False),  # once accepted, accepted
        ("as a woodcut", True, True),
    ],
)
def test_a_style_changes_its_part_alone(half, named, sentence, inner, outer):
    scene, inside = half
    how = {"names": named, "settings": BROAD, "accept_unread": True}
    result = gsedit.edit(scene, sentence, tiny_edits.data(), **how)
    inside = inside[result.origin]
    moved = (result.scene.sh - scene.sh[result.origin]).abs().amax((1, 2)) > 1e-4
    assert (bool(moved[inside].any()), bool(moved[~inside].any())) == (inner, outer)
    assert result.understood is not None
    assert result.targets


def test_exact_changes_and_styles_go_together(half, named):
    words = "make the blob bronze and the zog a woodcut"
    result = gsedit.edit(half[0], words, tiny_edits.data(), names=named, settings=BROAD)
    assert [change.route for change in result.understood.changes] == ["material", "style"]
    before, after = result.originals[0].image, result.finals[0].image
    assert ((before - after).abs().amax(-1) > 1 / 255)[before.amax(-1) > 0.1].float().mean() > 0.9
    assert {"change", "sample", "measure"} <= set(result.timings)
    evaluation = result.metrics.evaluation  # what takes longer than painting is left for later
    assert "gsedit metrics" in evaluation.not_measured["ssim_to_targets"]
    assert "psnr_to_targets" in evaluation.measured
    for view in (result.originals[0], result.held_out.originals[0]):  # of before all changes
        assert torch.equal(view.image, render_picture(half[0], view.camera))
    assert torch.equal(
        result.finals[0].image, render_picture(result.scene, result.finals[0].camera)
    )


def test_a_region_is_what_is_painted(half, tmp_path):
    scene, inside = half
    gsedit.select.region.save_region(gsedit.select.region.Region(inside), tmp_path / "half.npy")
    settings = EditSettings(brush=6.0, region=str(tmp_path / "half.npy"))
    result = gsedit.edit(scene, "as a woodcut", tiny_edits.data(), settings=settings)
    for each in ("sh", "means", "log_scales"):
        outside = getattr(result.scene, each)[~inside[result.origin]]
        assert torch.equal(outside, getattr(scene, each)[~inside])
    assert 1000 < len(result.scene) <= grain.MOST_TIMES * 1000
    assert "strokes are finer" in result.notes[-1]


def test_a_painting_goes_on_though_another_kernel_rounds_otherwise(half, monkeypatch):
    given, views = replace(BROAD, checkpoint_seconds=0.0, batches=1), tiny_edits.data()
    items = gsedit.edit_steps(half[0], "as a woodcut", views, settings=given)
    kept = next(each for each in items if isinstance(each, gsedit.Checkpoint))
    held = optimized_scene(kept.state.within("optimizer"), half[0])
    assert torch.equal(held.means, kept.scene.means)
    rounded = survey(half[0], [view.camera for view in views.split()[0]]).round(decimals=2)
    monkeypatch.setattr(grain, "survey", lambda *_: rounded)
    monkeypatch.setattr("gsedit.paper.draw.survey", None)  # the one before dividing is enough
    result = gsedit.edit(half[0], "as a woodcut", views, settings=given, resume=kept.state)
    assert len(result.scene) == len(held)
    assert result.timings["divide"] > 0


def test_a_preview_paints_its_part_alone(half, named):
    scene, data = half[0], tiny_edits.data()
    finder = Finder(scene, viewpoints_of(data), names=named)
    (step,) = steps_of(read_instruction("the blob as a woodcut", ["blob"]))
    painter, camera = make_editor(), data.views[0].camera
    region = drawn_region(finder, step, painter)
    shown = preview_edited(scene, step, camera, painter, region=region)
    other = preview_edited(scene, step, camera, painter)
    after, whole = shown.after, other.after
    apart = [float((each.image - shown.before.image).abs().mean()) for each in (after, whole)]
    assert 0 < apart[0] < apart[1]


def test_styles_of_one_part_are_mixed_in_one_step():
    (step,) = read_steps("a woodcut and a mosaic")
    assert [change.name for change in step.changes] == ["woodcut", "stained glass"]
    assert len(read_steps("make it darker; the bear a woodcut; the background a mosaic")) == 3


@pytest.mark.parametrize(
    ("sentence", "how", "told"),
    [
        ("as a hologram", {}, "nearest are stained glass, graffiti and nocturne"),
        ("in the style of Giacometti", {}, "no painting style resembles 'Giacometti'"),
        ("in the style of this picture", {}, "--like"),
        ("paint it red", {"editor": "painter"}, "asks for nothing that is drawn"),
        ("paint it red", {"strategy": SinglePass()}, "asks for nothing that is drawn"),
        ("paint it red", {"settings": EditSettings(batches=3)}, "asks for nothing that is drawn"),
        ("as a woodcut", {"editor": "closed-form"}, "closed-form editor does not know"),
    ],
)
def test_what_is_not_drawn_is_refused_with_the_next_move(sentence, how, told):
    how = {key: make_editor(v) if key == "editor" else v for key, v in how.items()}
    with pytest.raises(UsageError, match=told):
        prepare(tiny_edits.scene(), sentence, tiny_edits.data(), **how)
