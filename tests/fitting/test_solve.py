"""The least-squares solve of colors: exact targets, falling residual, nothing outside."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from closeness import EPS32, assert_near

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.solve import (
    PENALTIES,
    PENALTY,
    fit_color_map,
    solve_colors,
    trusting_penalty,
)
from gsedit.views.dataset import View
from rasterizer.blending.choose import is_compiled
from rasterizer.color_weights import color_weights
from rasterizer.numerics import SH_DC, Execution, color_to_sh, sh_to_color
from rasterizer.render import backproject, render

KERNELS = (Execution(), Execution(kernel="torch"))


@pytest.fixture(scope="module")
def scene():
    made = surface_gaussians(demo_scene(), 600, torch.Generator().manual_seed(0))
    dc = made.sh[:, :1].clamp(-1.5, 1.5)  # no color is clamped at black
    return replace(made, sh=dc)


@pytest.fixture(scope="module")
def cameras():
    return ring_cameras(demo_scene(), 6, 40)


def as_views(scene, cameras):
    return [View(str(i), c, render(scene, c).color) for i, c in enumerate(cameras)]


@pytest.mark.parametrize("execution", KERNELS, ids=("compiled", "torch"))
def test_weights_are_the_picture_and_its_transpose(scene, cameras, execution):
    weights = color_weights(scene, cameras[0], execution=execution)
    picture = weights.picture(sh_to_color(scene.sh[:, 0]))
    assert_near(picture, render(scene, cameras[0]).color, 200 * EPS32)  # sums of some 100 splats
    maps = torch.rand(picture.shape, generator=torch.Generator().manual_seed(1))
    expected = backproject(scene, cameras[0], maps)
    assert_near(weights.back(maps), expected, 200 * EPS32)
    part = (torch.arange(40) < 14).float()[:, None].expand(40, 40, 1)
    some, held = replace(weights, wanted=part[..., 0]), part * maps
    assert_near(part * some.picture(sh_to_color(scene.sh[:, 0])), part * picture, 200 * EPS32)
    assert_near(some.back(held), backproject(scene, cameras[0], held), 200 * EPS32)
    if execution == KERNELS[0] and is_compiled(execution):
        assert not some.picture(sh_to_color(scene.sh[:, 0]))[:, 14:].any()
        with pytest.raises(ValueError, match=r"wanted pixels are \(1, 40\)"):
            replace(weights, wanted=part[:1, :, 0]).back(maps)


def test_renders_of_other_colors_come_back(scene, cameras):
    shift = 0.2 * torch.rand(scene.sh.shape, generator=torch.Generator().manual_seed(2))
    other = replace(scene, sh=scene.sh + shift)
    targets, inside = as_views(other, cameras), torch.ones(len(scene), dtype=torch.bool)
    exact = {"most_iterations": 400, "least_gain_db": -1.0, "penalty": 1e-6}
    *_, last = solve_colors(scene, targets, inside, **exact)
    for view in targets:
        assert (render(last.scene, view.camera).color - view.image).abs().max() < 1e-4


def test_view_dependent_colors_come_back_too(scene, cameras):
    bands = torch.zeros(len(scene), 4, 3)
    bands[:, :1] = scene.sh.clamp_min(0)
    plain = replace(scene, sh=bands)
    shift = 0.1 * torch.rand(bands.shape, generator=torch.Generator().manual_seed(4))
    targets = as_views(replace(plain, sh=bands + shift), cameras)
    inside = torch.ones(len(scene), dtype=torch.bool)
    exact = {"most_iterations": 100, "least_gain_db": -1.0, "penalty": 1e-6, "band_penalty": 1e-6}
    *_, last = solve_colors(plain, targets, inside, **exact)
    for view in targets:
        assert (render(last.scene, view.camera).color - view.image).abs().max() < 1e-3
    flat = solve_colors(scene, targets, inside, most_iterations=100, least_gain_db=-1.0)
    assert last.mse < 0.01 * list(flat)[-1].mse


def test_the_residual_never_rises_and_nothing_outside_moves(scene, cameras):
    inside = scene.means[:, 0] > 0
    targets = [replace(v, image=1 - v.image) for v in as_views(scene, cameras)]
    solutions = list(solve_colors(scene, targets, inside, least_gain_db=-1.0))
    errors = [solution.mse for solution in solutions]
    assert all(later <= earlier * (1 + 1e-5) for earlier, later in pairwise(errors))
    solved = solutions[-1].scene
    assert torch.equal(solved.sh[~inside], scene.sh[~inside])
    assert not torch.equal(solved.sh[inside], scene.sh[inside])


def test_targets_that_are_the_renders_change_nothing(scene, cameras):
    inside = torch.ones(len(scene), dtype=torch.bool)
    for solution in solve_colors(scene, as_views(scene, cameras), inside):
        assert (solution.scene.sh - scene.sh).abs().max() < 1e-3 / SH_DC


def test_what_no_view_shows_follows_the_map_of_the_others(scene, cameras):
    """Colors of the views are halved and get a blue tint; hidden ones inside the region follow."""

    def night(colors):
        return 0.5 * colors + colors.new_tensor((0.0, 0.0, 0.1))

    hidden = torch.arange(len(scene)) % 50 == 0
    covered = replace(scene, logit_opacities=scene.logit_opacities.masked_fill(hidden, -torch.inf))
    base = sh_to_color(scene.sh)
    targets = as_views(replace(covered, sh=color_to_sh(night(base))), cameras)
    inside = torch.arange(len(scene)) % 100 != 0
    *_, last = solve_colors(covered, targets, inside)
    followed = hidden & inside
    solved = sh_to_color(last.scene.sh)
    assert (solved[followed] - night(base[followed])).abs().mean() < 0.02
    assert (base[followed] - night(base[followed])).abs().mean() > 0.1
    assert int(followed.sum()) <= last.followed < len(scene) // 2
    assert last.map_error < 0.05
    assert torch.equal(last.scene.sh[~inside], scene.sh[~inside])


def test_a_map_of_colors_is_found_again_and_stays_in_range():
    colors = torch.rand(200, 3, generator=torch.Generator().manual_seed(5))
    slope = torch.tensor([[0.2, 0.1, 0.0], [0.0, -0.3, 0.1], [0.0, 0.2, 0.4]])
    found = fit_color_map(colors, colors @ slope - 0.4, torch.ones(200))
    inner = 0.45 + 0.1 * colors
    assert torch.allclose(found.change(inner), inner @ slope - 0.4, atol=2e-2)
    assert (colors + found.change(colors)).min() >= -1e-6
    assert found.error < 0.01
    still = fit_color_map(colors, colors, torch.zeros(200))
    assert torch.equal(still.change(colors), torch.zeros_like(colors))


@pytest.mark.parametrize("logit", [-50.0, 50.0])
def test_a_solve_that_goes_on_at_its_minimum_stays_finite(scene, cameras, logit):
    faint = replace(scene, logit_opacities=torch.full_like(scene.logit_opacities, logit))[:40]
    random = torch.Generator().manual_seed(0)
    pictures = torch.rand(2, 40, 40, 3, generator=random)
    targets = [View(str(i), camera, pictures[i]) for i, camera in enumerate(cameras[:2])]
    inside = torch.ones(len(faint), dtype=torch.bool)
    found = list(solve_colors(faint, targets, inside, most_iterations=200, least_gain_db=-99.0))
    assert all(each.change.isfinite().all() for each in found)
    assert all(a.mse >= b.mse for a, b in pairwise(found))
    assert bool(found) == (logit > 0)


@pytest.mark.parametrize("pixels", [0, 2])
def test_targets_that_contradict_each_other_are_trusted_less(scene, pixels):
    """Every second picture is moved; the edit is a map of colors, which none of them needs."""
    cameras = ring_cameras(demo_scene(), 16, 48)
    true = [render(scene, each).color.clamp(0, 1).roll(1, -1) for each in cameras]
    targets = [
        View(str(i), cameras[i], true[i].roll(pixels * (i % 4 == 0), 1)) for i in range(0, 16, 2)
    ]
    inside = torch.ones(len(scene), dtype=torch.bool)
    found = trusting_penalty(scene, targets, inside)
    assert found == (PENALTIES[-1] if pixels else PENALTY)

    def error(penalty):
        *_, last = solve_colors(scene, targets, inside, penalty=penalty)
        between = zip(cameras[1::2], true[1::2])
        return sum(
            (render(last.scene, c).color - picture).square().mean() for c, picture in between
        )

    assert error(found) <= error(PENALTY)
    assert trusting_penalty(scene, targets[:5], inside) == PENALTY
