"""The tile renderer draws what the reference draws."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from closeness import EPS32, leaves, relative, tensors
from render_gradients import BACKGROUND, SEEDS, WHOLE_SUM, gradients
from scenes import EDGE_CASES, random_cloud
from scenes import camera as view_of

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from rasterizer import Camera, Gaussians, Numerics, look_at, render
from rasterizer.reference import render_reference

STOP = Numerics().transmittance_min


GRADIENT_BAR = 2e-4  # relative, of each input in float32


def both(scene: Gaussians, camera: Camera, dtype: torch.dtype, numerics: Numerics):
    found = render(
        scene.to(dtype),
        camera,
        background=BACKGROUND,
        depth=True,
        median_depth=True,
        numerics=numerics,
    )
    return found, render_reference(scene.to(dtype), camera, background=BACKGROUND)


@pytest.mark.parametrize("name", EDGE_CASES)
def test_float64_is_the_reference_to_rounding(name):
    found, wanted = both(*EDGE_CASES[name](), torch.float64, WHOLE_SUM)
    # offsets in standard deviations reach 1e6 on the needles: squared, that costs 1e-4 of 1e-16..
    assert (found.color - wanted.color).abs().max() < 1e-9
    assert (found.alpha - wanted.alpha).abs().max() < 1e-9
    assert (found.depth - wanted.depth).abs().max() < 1e-6
    assert (found.median_depth == wanted.median_depth).double().mean() > 0.999


@pytest.mark.parametrize("name", EDGE_CASES)
def test_float32_is_the_reference_to_float32_rounding(name):
    scene, camera = EDGE_CASES[name]()
    found, wanted = both(scene, camera, torch.float32, WHOLE_SUM)
    error = (found.color.double() - wanted.color).abs()
    # a splat whose alpha rounds to the other side of the floor 1/255 is wholly there or not
    flips = error > 1e-4
    assert flips.double().mean() < 2e-3
    assert error[flips].sum() <= flips.sum() * 1.5 / 255
    assert error[~flips].mean() < 1e-5


@pytest.mark.parametrize("name", EDGE_CASES)
def test_stopping_early_costs_less_than_the_threshold(name):
    scene, camera = EDGE_CASES[name]()
    whole = render(scene, camera, numerics=WHOLE_SUM).color
    stopped = render(scene, camera).color
    brightest = max(1.0, float(whole.max()))
    assert (whole - stopped).abs().max() <= STOP * brightest * 2  # color lost plus background shown


@pytest.mark.parametrize("name", EDGE_CASES)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_gradients_are_the_references(name, dtype):
    scene, camera = EDGE_CASES[name]()
    scene = scene.to(dtype)
    found = gradients(render, scene, camera, numerics=WHOLE_SUM)
    wanted = gradients(render_reference, scene.to(torch.float64), camera)
    bar = GRADIENT_BAR if dtype == torch.float32 else 1e-8
    # a gradient that is zero but for rounding has no relative error: compare to the largest
    tiny = EPS32 * max(float(g.abs().max()) for g in wanted.values() if g.numel())
    for of, exact in wanted.items():
        assert torch.isfinite(found[of]).all()
        if exact.numel() and exact.norm() > 1e3 * tiny:
            assert relative(found[of], exact) < bar, of


def test_gradcheck_in_float64():
    generator = torch.Generator().manual_seed(5)
    scene = random_cloud(6, 5, degree=2)
    camera = look_at(*torch.tensor([[0.0, 0, -1], [0, 0, 4], [0, -1, 0]]), 60.0, 9, 7)
    pose = camera.world_to_camera.clone().requires_grad_()
    # away from the floor and the cap, where the picture jumps
    opacities = torch.rand(len(scene), generator=generator, dtype=torch.float64) * 0.4 + 0.3
    numerics = Numerics(alpha_min=1e-9, transmittance_min=0.0)
    inputs = leaves(replace(scene, logit_opacities=torch.logit(opacities)))

    def picture(means, quats, log_scales, logits, sh, pose, background):
        rendered = render(
            Gaussians(means, quats, log_scales, logits, sh),
            replace(camera, world_to_camera=pose),
            background=background,
            depth=True,
            numerics=numerics,
        )
        return rendered.color, rendered.alpha, rendered.depth * rendered.alpha

    background = BACKGROUND.clone().requires_grad_()
    assert torch.autograd.gradcheck(picture, (*tensors(inputs), pose, background))


def errors32(scene: Gaussians, camera: Camera, numerics: Numerics) -> torch.Tensor:
    """Error of every color in float32, [h w 3]."""
    single = scene.to(torch.float32)
    found = render(single, camera, background=BACKGROUND, numerics=numerics).color
    return (found - render_reference(single, camera, background=BACKGROUND).color).abs()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("numerics", "tail", "mean"), [(WHOLE_SUM, 2e-5, 1e-6), (Numerics(), 1.2e-4, 5e-6)]
)
def test_float32_pictures_of_clouds_are_exact_to_the_promised_bars(seed, numerics, tail, mean):
    error = errors32(random_cloud(2000, seed, degree=3), view_of(96, 80, 100.0), numerics)
    assert torch.quantile(error.amax(-1).flatten(), 0.999) < tail
    assert error.mean() < mean


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("numerics", [WHOLE_SUM, Numerics()])
def test_float32_gradients_of_clouds_are_exact_to_the_promised_bars(seed, numerics):
    scene, camera = random_cloud(600, seed, degree=2).to(torch.float32), view_of(64, 48, 60.0)
    found = gradients(render, scene, camera, numerics=numerics)
    wanted = gradients(render_reference, scene.to(torch.float64), camera)
    for of, exact in wanted.items():
        assert relative(found[of], exact) < GRADIENT_BAR, of
        cosine = torch.nn.functional.cosine_similarity(
            found[of].double().flatten(), exact.flatten(), dim=0
        )
        assert cosine > 0.999999, of


def test_most_of_the_error_of_one_sample_is_the_blur_and_antialiasing_halves_it(record_property):
    """On a grid k times as fine the blur is held at 0.3 k^2 pixels, or shrinks to nothing."""
    scene = surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))
    (camera,) = ring_cameras(demo_scene(), 1, 96)

    def sampled(k, **numerics):
        lens = {name: k * getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
        finer = replace(camera, **lens, width=96 * k, height=96 * k)
        with torch.no_grad():
            color = render(scene, finer, numerics=Numerics(**numerics)).color
        return color.reshape(96, k, 96, k, 3).mean((1, 3))

    def rmse(ours, theirs):
        return float((ours - theirs).square().mean().sqrt())

    blurred, bare = sampled(16, blur=0.3 * 16**2), sampled(16, blur=1e-3)
    held, plain, smooth = (
        [rmse(sampled(k, **numerics(k)), theirs) for k in (1, 2, 4, 8)]
        for theirs, numerics in (
            (blurred, lambda k: {"blur": 0.3 * k**2}), (bare, lambda k: {}),
            (bare, lambda k: {"antialiased": True}),
        )
    )  # fmt: skip
    record_property("RMSE of 1, 4, 16, 64 samples", f"{held}; no blur: {plain}, {smooth}")
    assert held[0] < plain[0] / 5
    assert all(a < 0.6 * b for a, b in zip(smooth, plain))
    assert all(b < a / 3 for a, b in pairwise(held))
