"""The tile renderer draws what the reference draws, and obeys the laws of compositing."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import EPS32, leaves, relative, tensors, weights_like
from scenes import EXHIBITS, cloud, coincident, opaque_stack, random_cloud, wall

from rasterizer import Camera, Execution, Numerics, contributions, look_at, render
from rasterizer.reference import render_reference
from rasterizer.scene import Gaussians

WHOLE_SUM = Numerics(transmittance_min=0.0)
STOP = Numerics().transmittance_min
BACKGROUND = torch.tensor((0.2, 0.5, 0.9), dtype=torch.float64)


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


@pytest.mark.parametrize("name", EXHIBITS)
def test_float64_is_the_reference_to_rounding(name):
    found, wanted = both(*EXHIBITS[name](), torch.float64, WHOLE_SUM)
    # offsets in standard deviations reach 1e6 on the needles: squared, that costs 1e-4 of 1e-16..
    assert (found.color - wanted.color).abs().max() < 1e-9
    assert (found.alpha - wanted.alpha).abs().max() < 1e-9
    assert (found.depth - wanted.depth).abs().max() < 1e-6
    assert (found.median_depth == wanted.median_depth).double().mean() > 0.999


@pytest.mark.parametrize("name", EXHIBITS)
def test_float32_is_the_reference_to_float32_rounding(name):
    scene, camera = EXHIBITS[name]()
    found, wanted = both(scene, camera, torch.float32, WHOLE_SUM)
    error = (found.color.double() - wanted.color).abs()
    # a splat whose alpha rounds to the other side of the floor 1/255 is wholly there or not
    flips = error > 1e-4
    assert flips.double().mean() < 2e-3
    assert error[flips].sum() <= flips.sum() * 1.5 / 255
    assert error[~flips].mean() < 1e-5


@pytest.mark.parametrize("name", EXHIBITS)
def test_stopping_early_costs_less_than_the_threshold(name):
    scene, camera = EXHIBITS[name]()
    whole = render(scene, camera, numerics=WHOLE_SUM).color
    stopped = render(scene, camera).color
    brightest = max(1.0, float(whole.max()))
    assert (
        whole - stopped
    ).abs().max() <= STOP * brightest * 2  # colour lost plus background shown


@pytest.mark.parametrize("name", [n for n in EXHIBITS if n not in ("needle", "long_needle")])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_gradients_are_the_references(name, dtype):
    scene, camera = EXHIBITS[name]()
    scene = scene.to(dtype)
    pose = camera.world_to_camera.to(dtype).double()

    def gradients(function, scene, **options):
        inputs, moved = leaves(scene), pose.clone().requires_grad_()
        background = BACKGROUND.clone().requires_grad_()
        view = replace(camera, world_to_camera=moved)
        picture = function(inputs, view, background=background, **options)
        loss = (picture.color * weights_like(picture.color)).sum()
        loss = loss + (picture.alpha * weights_like(picture.alpha, 1)).sum()
        wanted = [*tensors(inputs), moved, background]
        return torch.autograd.grad(loss, wanted, allow_unused=True, materialize_grads=True)

    found = gradients(render, scene, numerics=WHOLE_SUM)
    wanted = gradients(render_reference, scene.to(torch.float64))
    bar = 1e-3 if dtype == torch.float32 else 1e-8
    for name_of, a, b in zip(("means", "quats", "scales", "opacities", "sh", "pose", "bg"),
                             found, wanted):  # fmt: skip
        assert torch.isfinite(a).all()
        # a gradient that is zero but for rounding has no relative error: compare to the largest
        tiny = EPS32 * max(float(g.abs().max()) for g in wanted if g.numel()) if len(scene) else 0
        if b.numel() and b.norm() > 1e3 * tiny:
            assert relative(a, b) < bar, name_of


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


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_tile_size_changes_nothing(dtype):
    scene, camera = cloud()
    pictures = [
        render(scene.to(dtype), camera, execution=Execution(tile_size=size)).color
        for size in (4, 8, 16, 32)
    ]
    # the exponent is summed from squares of up to (1.8 sigma a pixel x 23 pixels)^2 / 2 = 860
    rounding = 860 * torch.finfo(dtype).eps
    for picture in pictures[1:]:
        assert (picture - pictures[0]).abs().max() < rounding


def test_block_and_group_size_change_nothing(monkeypatch):
    from rasterizer import composite

    scene, camera = opaque_stack()

    def gradient():
        inputs = leaves(scene)
        picture = render(inputs, camera).color
        return picture.detach(), torch.autograd.grad(
            (picture * weights_like(picture)).sum(), tensors(inputs)
        )

    before, gradients_before = gradient()
    monkeypatch.setattr(composite, "BLOCK", 3)
    monkeypatch.setattr(composite, "ELEMENTS", 1000)
    after, gradients_after = gradient()
    assert (before - after).abs().max() < 1e-13
    largest = max(float(g.abs().max()) for g in gradients_before)
    for a, b in zip(gradients_before, gradients_after):
        assert (a - b).abs().max() < 1e-12 * largest


def test_input_order_changes_nothing_away_from_equal_depths():
    scene, camera = cloud()
    order = torch.randperm(len(scene), generator=torch.Generator().manual_seed(1))
    assert (render(scene, camera).color - render(scene[order], camera).color).abs().max() < 1e-12


def test_equal_depths_keep_file_order():
    scene, camera = coincident()
    pictures = [
        render(scene, camera, execution=Execution(tile_size=size)).color for size in (8, 32)
    ]
    assert (pictures[0] - pictures[1]).abs().max() < 1e-12
    first = render(scene, camera).color - render(scene.map(lambda t: t.flip(0)), camera).color
    assert first.abs().max() > 1e-3  # so the order did matter


def test_moving_scene_and_camera_together_changes_nothing():
    scene, camera = wall()
    turn = look_at(*torch.tensor([[1.0, 2, 3], [4, 1, -2], [0, -1, 0]]), 50.0, 8, 8)
    rotation, shift = turn.rotation, turn.world_to_camera[:3, 3]
    moved = replace(
        scene, means=scene.means @ rotation.T + shift, quats=_rotated(scene.quats, rotation)
    )
    pose = camera.world_to_camera @ torch.linalg.inv(turn.world_to_camera)
    there = render(moved, replace(camera, world_to_camera=pose), median_depth=True)
    here = render(scene, camera, median_depth=True)
    assert (here.color - there.color).abs().max() < 1e-9
    assert here.median_depth is not None
    assert there.median_depth is not None
    assert (here.median_depth - there.median_depth).abs().max() < 1e-9


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


def test_compositing_is_linear_in_color():
    scene, camera = cloud()
    bright = replace(scene, sh=scene.sh.abs()[:, :1])  # colours above 0: no clamp
    other = replace(bright, sh=bright.sh.flip(0))
    offset = replace(bright, sh=torch.zeros_like(bright.sh))
    mean = replace(bright, sh=(bright.sh + other.sh) / 2)
    grey = render(offset, camera).color
    a, b, both_ = (render(s, camera).color - grey for s in (bright, other, mean))
    assert ((a + b) / 2 - both_).abs().max() < 1e-12


def test_alpha_is_what_hides_the_background():
    scene, camera = cloud()
    black = render(scene, camera)
    white = render(scene, camera, background=torch.ones(3, dtype=torch.float64))
    through = (white.color - black.color).mean(-1)
    assert (black.alpha + through - 1).abs().max() < 1e-12


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


@pytest.mark.parametrize("name", ["empty", "behind", "off_screen"])
def test_backward_works_where_little_or_nothing_is_seen(name):
    scene, camera = EXHIBITS[name]()
    inputs = leaves(scene)
    picture = render(inputs, camera, depth=True)
    gradients = torch.autograd.grad(picture.color.sum() + picture.depth.sum(), tensors(inputs))
    assert all(torch.isfinite(g).all() for g in gradients)
