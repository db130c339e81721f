"""Every metric of a scene beside another: laws on a scene whose edit is known exactly."""

from dataclasses import replace

import pytest
import torch
from bench.staged import stages

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.measures.evaluation import evaluate
from gsedit.measures.formulas import psnr
from gsedit.measures.metrics import EvaluationInput
from gsedit.select.region import Region, coverage
from gsedit.views.view_list_files import ViewList
from gsedit.views.viewpoints import Viewpoint
from rasterizer.numerics import SH_DC
from rasterizer.render import render_picture

SIZE = 40
ROLES = ("held_out", "edited", "edited", "other", "held_out", "edited", "other", "other")


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 1500, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def views():
    cameras = ring_cameras(demo_scene(), 24, SIZE)[:8]
    named = tuple(Viewpoint(f"{i}.png", camera) for i, camera in enumerate(cameras))
    return ViewList(named, ROLES)


def brighter(scene, where=slice(None), by=0.1):
    sh = scene.sh.clone()
    sh[where, 0] += by / SH_DC
    return replace(scene, sh=sh)


def test_a_scene_beside_itself_is_equal(scene, views):
    found = evaluate(EvaluationInput(scene, views, unedited=scene))
    for name in ("psnr_to_unedited", "ssim_to_unedited", "rmse_to_unedited"):
        assert set(found.measured[name]) == {"edited", "held_out"}
    assert found.measured["psnr_to_unedited"]["edited"].value == 100
    assert found.measured["ssim_to_unedited"]["held_out"].value == pytest.approx(1, abs=1e-4)
    assert found.measured["rmse_to_unedited"]["edited"].value == 0
    assert {row.excess for row in found.warp} == {0}
    assert {row.range for row in found.warp} == {"short", "long"}
    assert found.number("edited") == 3
    assert found.number("held_out") == 2
    assert [view.name for view in found.views] == ["0.png", "1.png", "2.png", "4.png", "5.png"]


def test_a_known_change_has_its_strength_and_leaks_nothing(scene, views):
    inside = scene.means[:, 0] > scene.means[:, 0].median()
    region = Region(inside)
    edited = brighter(scene, inside)
    found = evaluate(EvaluationInput(edited, views, unedited=scene, region=region))
    strength = found.measured["rmse_to_unedited"]["edited"]
    assert 0.02 < strength.value < 0.1
    assert strength.views == 3
    leak = found.measured["rmse_outside_region"]["edited"].value
    assert leak < strength.value / 3
    assert found.measured["psnr_outside_region"]["edited"].value > 25
    everywhere = evaluate(EvaluationInput(brighter(scene), views, unedited=scene, region=region))
    assert everywhere.measured["rmse_outside_region"]["edited"].value > 3 * leak


def test_a_region_that_is_too_large_hides_what_given_masks_show(scene, views):
    """The edit's own region says that all is well; masks that it did not know do not."""
    upper = Region(scene.means[:, 2] > scene.means[:, 2].median())
    edited = brighter(scene, upper.inside, 0.2)
    subject = Region(scene.means[:, 2] > scene.means[:, 2].quantile(0.8))
    masks = {i: coverage(subject, scene, views.viewpoints[i].camera) for i in (0, 3, 5, 6)}
    found = evaluate(
        EvaluationInput(edited, views, unedited=scene, region=upper, subject_masks=masks)
    )
    own = found.measured["psnr_outside_region"]["held_out"]
    given = found.measured["psnr_outside_masks"]["all"]
    assert own.value > given.value + 5
    assert given.views == 4  # views of any role
    assert given.interval is not None
    assert given.interval[0] <= given.value <= given.interval[1]
    assert own.interval is None  # of two views
    assert (own.against, given.against) == ("the edit's own region", "masks that were given")
    exact = evaluate(
        EvaluationInput(
            brighter(scene, subject.inside, 0.2), views, unedited=scene, subject_masks=masks
        )
    )
    assert exact.measured["psnr_outside_masks"]["all"].value > given.value + 5


def test_targets_are_compared_view_by_view(scene, views):
    edited = brighter(scene)
    cameras = [each.camera for each in views.viewpoints]
    targets = {i: render_picture(edited, cameras[i]) for i in (1, 2, 4)}
    found = evaluate(EvaluationInput(scene, views, targets, unedited=scene))
    by_role = found.measured["psnr_to_targets"]
    assert (by_role["edited"].views, by_role["held_out"].views) == (2, 1)
    assert by_role["held_out"].value == pytest.approx(
        psnr(render_picture(scene, cameras[4]), targets[4])
    )
    values = {view.name: view.values for view in found.views}
    assert "psnr_to_targets" not in values["5.png"]
    assert "psnr_to_unedited" in values["5.png"]
    perfect = evaluate(EvaluationInput(edited, views, targets)).measured["psnr_to_targets"]
    assert perfect["edited"].value == 100


def test_colors_that_jump_between_views_are_an_excess(scene, views):
    """Targets that differ from view to view cannot agree; those of one edited scene do."""
    cameras = [each.camera for each in views.viewpoints]
    edited = brighter(scene)
    agreeing = {i: render_picture(edited, cameras[i]) for i in (1, 2, 5)}
    jumping = {i: (image + 0.1 * (i - 2)).clamp(0, 1) for i, image in agreeing.items()}
    rows = [
        next(
            row
            for row in evaluate(EvaluationInput(scene, views, each, unedited=scene)).warp
            if (row.pictures, row.range) == ("targets", "short")
        )
        for each in (agreeing, jumping)
    ]
    assert rows[0].unedited == rows[1].unedited
    assert rows[0].excess < 0.03
    assert rows[1].excess > 0.08


def test_exact_masks_of_a_staged_scene_tell_a_right_edit_from_one_that_spills():
    """The thing's own rays say where it is: neither Gaussians nor a region are asked."""
    stage = stages()[0]
    labelled, cameras = stage.gaussians(3000), stage.training(48)[:4]
    thing = stage.things[0]
    number = [each.name for each in stage.everything].index(thing.name)
    viewpoints = tuple(Viewpoint(f"{i}.png", camera) for i, camera in enumerate(cameras))
    masks = {i: (stage.label_map(c) == number).float() for i, c in enumerate(cameras)}
    own = labelled.of(thing.name)
    kept = [
        evaluate(
            EvaluationInput(
                brighter(labelled.scene, where, 0.3),
                ViewList(viewpoints, ("other",) * 4),
                unedited=labelled.scene,
                subject_masks=masks,
                max_perceptual_views=1,
            )
        ).measured["psnr_outside_masks"]["all"]
        for where in (own, torch.ones_like(own))
    ]
    assert kept[0].value > kept[1].value + 6
    assert kept[0].interval[0] > kept[1].interval[1]
