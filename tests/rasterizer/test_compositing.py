"""The laws of compositing: order, motion, linearity, crops; tiles and blocks change nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import EPS32, leaves, relative, tensors, weights_like
from render_gradients import SEEDS, WHOLE_SUM, gradients, largest_difference
from scenes import camera as view_of
from scenes import cloud, opaque_stack, random_cloud, wall

from rasterizer import Camera, Execution, Gaussians, Numerics, contributions, look_at, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.reference import render_reference

TORCH = Execution(kernel="torch")
STOP = Numerics().transmittance_min


@pytest.mark.parametrize(
    "execution",
    [
        *(replace(TORCH, tile_size=size) for size in (4, 8, 16, 32)),
        *(Execution(kernel="compiled", tile_size=size) for size in (None, 1, 3, 8, 16, 40)),
    ],
    ids=lambda e: f"tile {e.tile_size} {e.kernel}",
)
@pytest.mark.parametrize("seed", SEEDS)
def test_how_it_is_computed_changes_nothing(execution, seed):
    if execution.kernel == "compiled" and compiled.load() is None:
        pytest.skip("no C++ compiler works here")
    scene, camera = random_cloud(200, seed, degree=1), view_of()
    wanted = render(scene, camera, numerics=WHOLE_SUM, execution=TORCH)
    found = render(scene, camera, numerics=WHOLE_SUM, execution=execution)
    # the exponent is summed from squares of up to (1.8 sigma a pixel x 23 pixels)^2 / 2 = 860
    assert (found.color - wanted.color).abs().max() < 860 * torch.finfo(torch.float64).eps
    exact = gradients(render, scene, camera, numerics=WHOLE_SUM, execution=TORCH)
    again = gradients(render, scene, camera, numerics=WHOLE_SUM, execution=execution)
    assert largest_difference(again, exact) < 1e-11  # 860 roundings and their sums over pixels
    single = render(scene.to(torch.float32), camera, numerics=WHOLE_SUM, execution=execution)
    assert (single.color - wanted.color).abs().max() < 860 * EPS32


def test_more_tiles_than_sixteen_bits_count():
    scene, camera = random_cloud(50, 11), view_of(1040, 1040, 1000.0)
    wanted, found = (
        render(scene, camera, numerics=WHOLE_SUM, execution=Execution(tile_size=size)).color
        for size in (32, 4)
    )
    assert (1040 // 4) ** 2 > 1 << 16
    assert (found - wanted).abs().max() < 1e-12


@pytest.mark.parametrize("execution", [Execution(tile_size=4), replace(TORCH, tile_size=8)])
def test_where_the_stop_falls_costs_less_than_the_threshold(execution):
    scene, camera = opaque_stack()  # a tile stops at another layer if it or its block is smaller
    wanted = render(scene, camera).color
    assert (render(scene, camera, execution=execution).color - wanted).abs().max() < 2 * STOP


@pytest.mark.parametrize("seed", SEEDS)
def test_input_order_changes_nothing_away_from_equal_depths(seed):
    scene, camera = random_cloud(200, seed, degree=1), view_of()
    order = torch.randperm(len(scene), generator=torch.Generator().manual_seed(seed))
    assert (render(scene, camera).color - render(scene[order], camera).color).abs().max() < 1e-12
    shuffled = gradients(lambda s, c, **o: render(s[order], c, **o), scene, camera)
    assert largest_difference(shuffled, gradients(render, scene, camera)) < 1e-11


def test_equal_positions_are_sorted_stably():
    scene, camera = random_cloud(100, 7), view_of()
    twice = scene[torch.arange(100) // 2 * 2]  # pairs of the same depth, and colors that differ
    twice = replace(twice, sh=scene.sh)
    wanted = render_reference(twice, camera).color
    assert (render(twice, camera, numerics=WHOLE_SUM).color - wanted).abs().max() < 1e-12
    swapped = twice[torch.arange(100) // 2 * 2 + 1 - torch.arange(100) % 2]
    assert (render(swapped, camera, numerics=WHOLE_SUM).color - wanted).abs().max() > 1e-3


def elsewhere(scene: Gaussians, camera: Camera, **options):
    """One view of one scene, both moved to another place and turned."""
    turn = look_at(*torch.tensor([[1.0, 2, 3], [4, 1, -2], [0, -1, 0]]), 50.0, 8, 8)
    means = scene.means @ turn.rotation.T + turn.world_to_camera[:3, 3]
    moved = replace(scene, means=means, quats=_rotated(scene.quats, turn.rotation))
    pose = camera.world_to_camera @ torch.linalg.inv(turn.world_to_camera)
    return render(moved, replace(camera, world_to_camera=pose), **options)


def test_moving_scene_and_camera_together_changes_nothing():
    scene, camera = wall()
    there = elsewhere(scene, camera, median_depth=True)
    here = render(scene, camera, median_depth=True)
    assert (here.color - there.color).abs().max() < 1e-9
    assert here.median_depth is not None
    assert there.median_depth is not None
    assert (here.median_depth - there.median_depth).abs().max() < 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_moving_scene_and_camera_together_changes_no_gradient(seed):
    # degree 0: colors that depend on the view would have to turn too; no equal depths, unlike wall
    scene, camera = random_cloud(200, seed), view_of()
    assert (render(scene, camera).color - elsewhere(scene, camera).color).abs().max() < 1e-12
    wanted = gradients(render, scene, camera)
    assert largest_difference(gradients(elsewhere, scene, camera), wanted) < 1e-11


def _rotated(quats, rotation):
    """Quaternions turned by a rotation matrix: Hamilton product with that of the matrix."""
    w = (1 + rotation.trace()).sqrt() / 2
    x = (rotation[2, 1] - rotation[1, 2]) / (4 * w)
    y = (rotation[0, 2] - rotation[2, 0]) / (4 * w)
    z = (rotation[1, 0] - rotation[0, 1]) / (4 * w)
    left = torch.stack(
        (
            torch.stack((w, -x, -y, -z)),
            torch.stack((x, w, -z, y)),
            torch.stack((y, z, w, -x)),
            torch.stack((z, -y, x, w)),
        )
    )
    return quats @ left.T


@pytest.mark.parametrize("seed", SEEDS)
def test_compositing_is_linear_in_color(seed):
    scene, camera = random_cloud(200, seed), view_of()
    bright = replace(scene, sh=scene.sh.abs())  # colors above 0: no clamp
    other = replace(bright, sh=bright.sh.flip(0))
    offset = replace(bright, sh=torch.zeros_like(bright.sh))
    mean = replace(bright, sh=(bright.sh + 3 * other.sh) / 4)
    grey = render(offset, camera).color
    a, b, mixed = (render(s, camera).color - grey for s in (bright, other, mean))
    assert ((a + 3 * b) / 4 - mixed).abs().max() < 1e-12
    # so the gradient by color is the same at every color, and weights the colors' picture
    first, second = (gradients(render, s, camera)["sh"] for s in (bright, other))
    assert relative(first, second) < 1e-12
    assert (first * bright.sh).sum().item() == pytest.approx(
        (a * weights_like(a)).sum().item(), rel=1e-10
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_alpha_is_what_hides_the_background(seed):
    scene, camera = random_cloud(200, seed, degree=1), view_of()
    black = render(scene, camera)
    white = render(scene, camera, background=torch.ones(3, dtype=torch.float64))
    through = white.color - black.color
    assert (black.alpha[..., None] + through - 1).abs().max() < 1e-12
    by_background = (weights_like(black.color) * through).sum((0, 1))
    assert relative(gradients(render, scene, camera)["background"], by_background) < 1e-12
    # and so the gradients of alpha and of what passes cancel
    inputs = leaves(scene)
    both_ = render(inputs, camera, background=torch.ones(3, dtype=torch.float64))
    alone = render(inputs, camera)
    nothing = ((both_.color - alone.color).sum() + 3 * alone.alpha.sum(), tensors(inputs))
    assert all(g.abs().max() < 1e-10 for g in torch.autograd.grad(*nothing))


@pytest.mark.parametrize("box", [(0, 0, 40, 32), (5, 3, 17, 9), (39, 31, 1, 1), (8, 8, 16, 16)])
def test_a_crop_is_that_part_of_the_picture(box):
    scene, camera = cloud()
    left, top, width, height = box
    whole = render(scene, camera, depth=True, median_depth=True)
    part = render(scene, camera, crop=box, depth=True, median_depth=True)
    for name in ("color", "alpha", "depth", "median_depth"):
        wanted = getattr(whole, name)[top : top + height, left : left + width]
        assert (getattr(part, name) - wanted).abs().max() < 1e-11


@pytest.mark.parametrize("box", [(0, 0, 41, 3), (-1, 0, 3, 3), (0, 0, 0, 4)])
def test_a_crop_outside_the_picture_is_refused(box):
    scene, camera = cloud()
    with pytest.raises(ValueError, match="crop"):
        render(scene, camera, crop=box)


def test_contributions_sum_to_the_alpha_of_the_picture():
    scene, camera = cloud()
    seen = contributions(scene, camera)
    assert seen.shape == (len(scene),)
    assert seen.sum().item() == pytest.approx(render(scene, camera).alpha.sum().item(), rel=1e-12)
