"""Pixels that a mask hides say nothing; transparent photos ask for a transparent scene."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from gsedit import Dataset, FitSettings, View, fit
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.fit import evaluate
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.photometric import supervised
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.capture.fitting.update import Target, rates, update_steps
from gsedit.errors import UsageError
from gsedit.measures import losses
from gsedit.measures.features import FilterBank
from gsedit.views.dataset import capture
from rasterizer import render

SIZE = 64


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 600, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def views(scene):
    cameras = ring_cameras(demo_scene(), 9, SIZE)
    return capture(scene, cameras, [f"{i}.png" for i in range(9)])


def masked(view: View, hidden: torch.Tensor | None = None) -> View:
    """Its left third hidden, by default, and `hidden` painted there."""
    mask = torch.ones(SIZE, SIZE, dtype=torch.bool)
    mask[:, : SIZE // 3] = False
    image = view.image if hidden is None else torch.where(mask[..., None], view.image, hidden)
    return replace(view, image=image, mask=mask)


def painted(views: tuple[View, ...], seed: int) -> tuple[View, ...]:
    draw = torch.Generator().manual_seed(seed)
    return tuple(masked(view, torch.rand(SIZE, SIZE, 3, generator=draw)) for view in views)


@pytest.mark.parametrize("loss", [losses.mse, losses.l1, losses.dssim])
def test_a_masked_pixel_has_no_gradient_and_no_say(loss, views):
    """Not through the windows of SSIM either, and nothing is lost inside."""
    first, second = painted(views[:1], 0)[0], painted(views[:1], 1)[0]
    gradients = []
    for view in (first, second):
        picture = views[1].image.clone().requires_grad_()
        loss(*supervised(picture, view.image, view.mask)).backward()
        gradients.append(picture.grad)
    assert torch.equal(gradients[0], gradients[1])
    assert not gradients[0][~first.mask].any()
    assert gradients[0][first.mask].abs().max() > 0
    picture = views[1].image
    assert supervised(picture, first.image, None)[1] is first.image


def test_a_fit_takes_nothing_from_masked_pixels(scene, views):
    settings = FitSettings(steps=12, seconds=None, densify_every=5, coarse=((0.5, 16),))
    start = scene[::3]
    results = [fit(Dataset(painted(views, seed)), settings, start=start) for seed in (0, 1)]
    assert torch.equal(results[0].scene.means, results[1].scene.means)
    assert torch.equal(results[0].scene.sh, results[1].scene.sh)
    assert results[0].psnr == results[1].psnr


def test_an_update_takes_nothing_from_masked_pixels(scene, views):
    colors = []
    for seed in (0, 1):
        targets = [Target(view) for view in (*painted(views[:2], seed), views[2])]
        optimizer = SceneOptimizer(scene, rates("appearance", 1.0))
        everything = torch.ones(len(scene), dtype=torch.bool)
        settings = UpdateSettings(loss="mse+0.1*gram", patches=2, patch=16)
        generator = torch.Generator().manual_seed(0)
        steps = update_steps(
            optimizer, targets, everything, range(4), 4, settings, FilterBank(), generator
        )
        assert len(list(steps)) == 4
        colors.append(optimizer.scene.sh.detach())
    assert torch.equal(*colors)


def test_masked_pixels_are_not_measured(scene, views):
    wrong = painted(views[:2], 0)
    assert evaluate(scene, wrong) > 100  # the rest is exact
    nothing = replace(views[0], mask=torch.zeros(SIZE, SIZE, dtype=torch.bool))
    assert evaluate(scene, (*wrong, nothing)) == evaluate(scene, wrong)
    with pytest.raises(UsageError, match="masks hide every"):
        evaluate(scene, (nothing,))


def test_a_transparent_photo_asks_for_a_transparent_scene(scene, views):
    """Surroundings that are empty, as in Blender's sets, get no shell of a color.

    The scene that made the photos fits them in front of any background, so that a fit has no
    reason to put anything around it; with the photos laid over white it has.
    """
    drawn = [render(scene, view.camera) for view in views]
    cut_out = [replace(view, alpha=one.alpha) for view, one in zip(views, drawn)]
    generator = torch.Generator().manual_seed(0)
    for view in cut_out:
        background = torch.rand(3, generator=generator)
        picture = render(scene, view.camera, background=background).color
        torch.testing.assert_close(picture, view.over(background), atol=1e-5, rtol=0)
    white = torch.ones(3)
    filled = [View(view.name, view.camera, view.over(white)) for view in cut_out]
    cloud = replace(scene, means=scene.means * 1.6, logit_opacities=torch.zeros(len(scene)))[::3]
    settings = FitSettings(steps=40, seconds=None, densify_every=1000)
    haze = []
    for each in (cut_out, filled):
        fitted = fit(Dataset(tuple(each)), settings, start=cloud).scene
        alphas = [render(fitted, v.camera).alpha[d.alpha < 0.01] for v, d in zip(views, drawn)]
        haze.append(float(torch.cat(alphas).mean()))
    assert haze[0] < 0.8 * haze[1]


def test_metrics_leave_out_masked_pixels(scene, views):
    from gsedit.measures.evaluation import evaluate as evaluation
    from gsedit.measures.formulas import NEAREST
    from gsedit.measures.metrics import EvaluationInput
    from gsedit.views.view_list_files import by_capture
    from gsedit.views.viewpoints import viewpoints_of

    photos = painted(views[:3], 0)
    hidden = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    subject = EvaluationInput(
        scene,
        by_capture(viewpoints_of(Dataset(photos))),
        {i: photo.image for i, photo in enumerate(photos)},
        masks={0: photos[0].mask, 1: photos[1].mask, 2: hidden},
    )
    measured = evaluation(subject).measured
    assert measured["psnr_to_targets"]["held_out"].value == NEAREST
    assert measured["ssim_to_targets"]["edited"].value > 0.9999
    assert measured["psnr_to_targets"]["edited"].views == 1  # the third shows nothing
