"""Fitting finds the scene behind ray-traced photos, and grows and prunes it lawfully."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from point_clouds import ball
from small_scenes import generator, scenes, traced_dataset

from gsedit import Checkpoint, Dataset, Event, FitSettings, fit, fit_steps
from gsedit.bench.synthetic import ring_cameras
from gsedit.capture.fitting.densify import densify, divided, faded, without_floaters
from gsedit.capture.fitting.fit import evaluate
from gsedit.capture.fitting.initial import initial_scene
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.settings import LEAST_STEPS
from gsedit.errors import UsageError
from gsedit.formats.mesh import neighbor_distance
from rasterizer.project import rotation_matrices
from rasterizer.scene import concatenate


def photos(count: int = 16, size: int = 48):
    """A globe that fills the pictures, and points on it without colors."""
    ring = ring_cameras(scenes()[0], count, size)
    cameras = [replace(c, fx=2.2 * c.fx, fy=2.2 * c.fy) for c in ring]
    return replace(traced_dataset(scenes()[0], cameras, points=500), point_colors=None)


def test_a_short_fit_gains_many_decibels_on_views_it_never_saw():
    data = photos()
    before = evaluate(initial_scene(data, 0, generator()), data.split()[1])
    settings = FitSettings(
        steps=300,
        dense_start=0,
        seconds=None,
        sh_degree=0,
        densify_every=40,
        checkpoint_seconds=0.0,
    )
    items = list(fit_steps(data, settings, generator=generator()))
    result = items[-1]
    assert result.steps == 300
    assert result.psnr > before + 4
    assert result.psnr == pytest.approx(evaluate(result.scene, data.split()[1]))
    assert result.curve[-1][1] == result.psnr
    assert len(result.scene) > 500  # it grew
    assert any(isinstance(i, Checkpoint) for i in items)
    measured = [i for i in items if isinstance(i, Event) and i.stage == "measure"]
    assert len(measured) >= 10
    assert measured[-1].error == pytest.approx(10 ** (-result.psnr / 20))


def test_a_budget_that_the_photos_use_up_still_makes_a_few_steps():
    settings = FitSettings(seconds=1e-9, dense_start=50, coarse=())
    data = photos(5, 16)
    start = initial_scene(data, 1, generator())
    *_, result = fit_steps(data, settings, generator=generator(), start=start)
    assert result.steps == LEAST_STEPS
    assert len(result.curve) <= 2  # at the first step, and at the end
    assert (result.scene.sh - start.sh).abs().max() > 1e-3  # the rates are the budget's last
    *_, result = fit_steps(data, replace(settings, steps=3), generator=generator())
    assert result.steps == 3


def test_a_fit_without_budget_or_photos_is_refused():
    data = photos(3, 16)
    with pytest.raises(UsageError, match="--minutes"):
        FitSettings(steps=None)
    for wrong in (
        {"steps": 0},
        {"seconds": float("nan")},
        {"seconds": -1.0},
        {"sh_degree": 4},
        {"densify_every": 0},
        {"report_every": 0},
        {"evaluations": 0},
        {"max_gaussians": -5},
        {"dssim_weight": float("nan")},
        {"dense_start": -1},
        {"checkpoint_seconds": float("nan")},
    ):
        with pytest.raises(UsageError, match="is"):
            FitSettings(**wrong)
    with pytest.raises(UsageError, match="photos"):
        next(fit_steps(replace(data, views=data.views[:1]), generator=generator()))


def test_the_first_scene_is_the_sparse_points():
    data = photos(3, 16)
    scene = initial_scene(data, 2, generator())
    assert data.points is not None
    assert torch.allclose(scene.means.double(), data.points.double(), atol=1e-6)
    assert scene.degree == 2
    spacing = torch.from_numpy(neighbor_distance(scene.means.double().numpy())).float()
    assert torch.allclose(scene.log_scales.exp()[:, 0], spacing)
    without = initial_scene(replace(data, points=None, point_colors=None), 0, generator())
    assert len(without) > 1000


def test_densify_divides_the_strongest_and_drops_the_transparent():
    scene = ball(100)
    logits = scene.logit_opacities.clone()
    logits[:10] = -20.0
    scene = replace(scene, logit_opacities=logits)
    pull = torch.zeros(100)
    pull[50:60] = 1.0
    grown, origin, fresh = densify(scene, pull, 1000, most=10 / 90)
    assert len(grown) == 100 - 10 + 10
    assert sorted(origin[fresh].tolist()) == sorted([*range(50, 60)] * 2)
    assert not set(range(10)) & set(origin.tolist())
    kept = grown[~fresh]
    assert torch.equal(kept.means, scene.means[origin[~fresh]])


@pytest.mark.parametrize("densified", [True, False])
def test_pieces_have_the_mass_the_mean_and_the_covariance_of_the_whole(densified):
    scene = ball(5)
    longer = scene.log_scales + torch.tensor([0.0, 1.0, -0.5])
    scene = replace(scene, log_scales=longer, quats=torch.randn(5, 4, generator=generator()))
    if densified:
        halves, origin, fresh = densify(scene, torch.ones(5), 10, most=1.0)
        scene = faded(scene)
        assert fresh.all()
    else:
        wanted = torch.tensor([0.0, *[float(scene.scales.max()) / 3] * 4])  # 0: no camera sees it
        halves, origin = divided(scene, wanted, torch.ones(5), 100)
        assert (halves.scales.amax(1) <= 1.15 * wanted[1])[origin > 0].all()
        assert len(halves) > 20 > (origin == 0).sum() == 1

    def moments(part):
        axes = rotation_matrices(part.quats) * part.scales[:, None]
        mass = part.opacities * part.scales.prod(-1)
        spread = axes @ axes.mT + part.means[:, :, None] * part.means[:, None]
        return mass, mass[:, None] * part.means, mass[:, None, None] * spread

    for whole, half in zip(moments(scene), moments(halves)):
        together = torch.zeros_like(whole).index_add(0, origin, half)
        torch.testing.assert_close(together, whole, rtol=1e-4, atol=1e-6)


def test_densify_stops_at_the_target_and_the_share():
    pull = torch.rand(100, generator=generator())
    for target, number in ((106, 106), (120, 110), (50, 100)):
        assert len(densify(ball(100), pull, target).scene) == number


def test_what_hangs_before_a_camera_is_a_floater_and_a_near_thing_is_not():
    scene, cameras = ball(300), [view.camera.fitted(32) for view in photos(3, 48).views]
    one = cameras[0]
    hanging = scene[:4].map(torch.clone)
    hanging.means[:] = (one.center + 0.2 * one.forward).float()
    hanging.log_scales[:] = -7.0
    cleared, origin, fresh = without_floaters(concatenate(scene, hanging), cameras)
    assert origin.tolist() == list(range(300))
    assert not fresh.any()
    hanging.log_scales[:] = -2.5  # a fist before the lens fills the picture: it was there
    assert len(without_floaters(concatenate(scene, hanging), cameras).scene) == 304
    assert len(without_floaters(cleared, [])[0]) == 300


def test_replacing_the_scene_keeps_the_moments_of_the_rows_that_stay():
    one = SceneOptimizer(ball(6), {"means": 0.1})
    two = SceneOptimizer(ball(6), {"means": 0.1})

    def pull(optimizer, rows=slice(None)):
        (optimizer.scene.means[rows] * torch.arange(1.0, 4.0)).sum().backward()
        optimizer.step()

    pull(one)
    pull(two)
    order = torch.tensor([3, 1, 5])
    two.replace(two.scene.detach()[order], order, torch.tensor([False, False, True]))
    pull(one)
    pull(two)
    assert torch.allclose(one.scene.means[order[:2]], two.scene.means[:2])
    assert not torch.allclose(one.scene.means[5], two.scene.means[2])


def test_a_photo_too_small_for_the_loss_is_refused_and_fitted_without_ssim():
    small = traced_dataset(scenes()[0], ring_cameras(scenes()[0], 4, 12), points=50)
    flat = [one.resized(12, 5) for one in small.views]
    data = Dataset((*small.views[:2], *flat), small.points, small.point_colors)
    settings = FitSettings(steps=2, seconds=None, dense_start=0)
    assert fit(small, settings).steps == 2
    with pytest.raises(
        UsageError, match=r"has 12x5 pixels, and SSIM needs 6 .*--set dssim_weight=0"
    ):
        fit(data, settings)
    settings = FitSettings(steps=2, seconds=None, dense_start=0, dssim_weight=0.0)
    assert fit(data, settings).steps == 2
