"""The tile renderer draws what the reference draws, and obeys the laws of compositing."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
import torch
from closeness import EPS32, INPUTS, leaves, relative, tensors, weights_like
from scenes import EDGE_CASES, cloud, coincident, opaque_stack, random_cloud, wall
from scenes import camera as view_of

from rasterizer import Camera, Execution, Numerics, contributions, look_at, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.numerics import SH_DC
from rasterizer.project import project
from rasterizer.reference import render_reference
from rasterizer.scene import Gaussians

WHOLE_SUM = Numerics(transmittance_min=0.0)
STOP = Numerics().transmittance_min
GRADIENT_BAR = 2e-4  # relative, of each input in float32
SEEDS = (11, 12, 13)
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


def gradients(function, scene: Gaussians, camera: Camera, **options) -> dict[str, torch.Tensor]:
    """Of a loss that hides no pixel, by every input: the pose and the background too."""
    inputs, pose = leaves(scene), camera.world_to_camera.clone().requires_grad_()
    background = BACKGROUND.clone().requires_grad_()
    view = replace(camera, world_to_camera=pose)
    picture = function(inputs, view, background=background, **options)
    loss = (picture.color * weights_like(picture.color)).sum()
    loss = loss + (picture.alpha * weights_like(picture.alpha, 1)).sum()
    wanted = [*tensors(inputs), pose, background]
    found = torch.autograd.grad(loss, wanted, allow_unused=True, materialize_grads=True)
    return dict(zip((*INPUTS, "pose", "background"), found))


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
    assert (
        whole - stopped
    ).abs().max() <= STOP * brightest * 2  # colour lost plus background shown


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
    for of, truth in wanted.items():
        assert torch.isfinite(found[of]).all()
        if truth.numel() and truth.norm() > 1e3 * tiny:
            assert relative(found[of], truth) < bar, of


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


def largest_difference(found: dict[str, torch.Tensor], wanted: dict[str, torch.Tensor]) -> float:
    """Of any input's gradient, relative."""
    return max(relative(found[of], wanted[of]) for of in wanted)


@pytest.mark.parametrize(
    "execution",
    [
        *(Execution(tile_size=size) for size in (4, 8, 16, 32)),
        *(Execution(block=block) for block in (1, 3, 64)),
        Execution(cull="box"),
        pytest.param(
            Execution(compile=True),
            marks=pytest.mark.skipif(compiled.load() is None, reason="no C++ compiler works here"),
        ),
    ],
    ids=lambda e: f"tile {e.tile_size} block {e.block} cull {e.cull} compile {e.compile}",
)
@pytest.mark.parametrize("seed", SEEDS)
def test_how_it_is_computed_changes_nothing(execution, seed):
    scene, camera = random_cloud(200, seed, degree=1), view_of()
    wanted = render(scene, camera, numerics=WHOLE_SUM)
    found = render(scene, camera, numerics=WHOLE_SUM, execution=execution)
    # the exponent is summed from squares of up to (1.8 sigma a pixel x 23 pixels)^2 / 2 = 860
    assert (found.color - wanted.color).abs().max() < 860 * torch.finfo(torch.float64).eps
    exact = gradients(render, scene, camera, numerics=WHOLE_SUM)
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


@pytest.mark.parametrize("execution", [Execution(tile_size=4), Execution(block=3)])
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


def test_equal_depths_keep_file_order():
    scene, camera = coincident()
    pictures = [
        render(scene, camera, execution=Execution(tile_size=size)).color for size in (8, 32)
    ]
    assert (pictures[0] - pictures[1]).abs().max() < 1e-12
    first = render(scene, camera).color - render(scene.map(lambda t: t.flip(0)), camera).color
    assert first.abs().max() > 1e-3  # so the order did matter


def test_equal_positions_are_sorted_stably():
    scene, camera = random_cloud(100, 7), view_of()
    twice = scene[torch.arange(100) // 2 * 2]  # pairs of the same depth, and colours that differ
    twice = replace(twice, sh=scene.sh)
    wanted = render_reference(twice, camera).color
    assert (render(twice, camera, numerics=WHOLE_SUM).color - wanted).abs().max() < 1e-12
    swapped = twice[torch.arange(100) // 2 * 2 + 1 - torch.arange(100) % 2]
    assert (render(swapped, camera, numerics=WHOLE_SUM).color - wanted).abs().max() > 1e-3


def elsewhere(scene: Gaussians, camera: Camera, **options):
    """The same view of the same scene, both moved to another place and turned."""
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
    # degree 0: colours that depend on the view would have to turn too; no equal depths, unlike wall
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
    bright = replace(scene, sh=scene.sh.abs())  # colours above 0: no clamp
    other = replace(bright, sh=bright.sh.flip(0))
    offset = replace(bright, sh=torch.zeros_like(bright.sh))
    mean = replace(bright, sh=(bright.sh + 3 * other.sh) / 4)
    grey = render(offset, camera).color
    a, b, mixed = (render(s, camera).color - grey for s in (bright, other, mean))
    assert ((a + 3 * b) / 4 - mixed).abs().max() < 1e-12
    # so the gradient by colour is the same at every colour, and weights the colours' picture
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


@pytest.mark.parametrize("name", ["empty", "behind", "off_screen"])
def test_backward_works_where_little_or_nothing_is_seen(name):
    scene, camera = EDGE_CASES[name]()
    inputs = leaves(scene)
    picture = render(inputs, camera, depth=True)
    gradients = torch.autograd.grad(picture.color.sum() + picture.depth.sum(), tensors(inputs))
    assert all(torch.isfinite(g).all() for g in gradients)


def errors32(scene: Gaussians, camera: Camera, numerics: Numerics) -> torch.Tensor:
    """Of every colour, [h w 3]."""
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
    for of, truth in wanted.items():
        assert relative(found[of], truth) < GRADIENT_BAR, of
        cosine = torch.nn.functional.cosine_similarity(
            found[of].double().flatten(), truth.flatten(), dim=0
        )
        assert cosine > 0.999999, of


# Largest relative error of an alpha near the floor in float32: its exponent is a sum of squares of
# up to 100 (5.5 comes out at the floor), each rounded a few times.
FLOOR_ROUNDING = 400 * EPS32


def on_the_floor(scene: Gaussians, camera: Camera) -> Gaussians:
    """The scene with 80 opacities such that an alpha is 1/255 at some pixel, but for rounding."""
    flat = project(scene, camera, Numerics())
    pixels = camera.pixel_centres().reshape(-1, 2)
    logits = scene.logit_opacities.clone()
    for row in range(80):
        power = _powers(flat, pixels)[:, row]
        at = (power - 4.0).abs().argmin()  # two and a half standard deviations off
        logits[row] = torch.logit((power[at].exp() / 255).clamp_max(0.9))
    return replace(scene, logit_opacities=logits)


def _powers(flat, pixels: torch.Tensor) -> torch.Tensor:
    """|W (p - xy)|^2 / 2 of every pixel and Gaussian, by the factor itself."""
    dx, dy = (pixels[:, None] - flat.xy).unbind(-1)
    w0, w1, w2 = flat.whitening.unbind(-1)
    return ((w0 * dx) ** 2 + (w1 * dx + w2 * dy) ** 2) / 2


@pytest.mark.parametrize("seed", SEEDS)
def test_larger_float32_errors_are_alphas_on_the_other_side_of_the_floor(seed):
    view = view_of()
    scene = on_the_floor(random_cloud(150, seed), view).to(torch.float32)
    found = render(scene, view, numerics=WHOLE_SUM).color.double()
    wanted = render_reference(scene, view).color
    error = (found - wanted).abs().amax(-1)
    flipped = (error > 2e-5).nonzero()
    assert len(flipped) > 5  # so the explanation below is put to the test
    exact = scene.to(torch.float64)
    flat = project(exact, view, WHOLE_SUM)
    order = flat.sort_depth.argsort(stable=True)
    colors = (0.5 + SH_DC * exact.sh[order, 0]).clamp_min(0)
    for y, x in flipped.tolist():
        pixel = torch.tensor([[x + 0.5, y + 0.5]], dtype=torch.float64)
        alpha = (exact.opacities * torch.exp(-_powers(flat, pixel)[0]))[order].clamp_max(0.99)
        doubtful = ((alpha * 255 - 1).abs() < FLOOR_ROUNDING).nonzero().flatten()
        assert 0 < len(doubtful) < 8
        sure = torch.where(alpha >= 1 / 255, alpha, 0.0)
        explained = []
        for kept in itertools.product((0.0, 1.0), repeat=len(doubtful)):
            sure[doubtful] = alpha[doubtful] * torch.tensor(kept, dtype=torch.float64)
            passed = torch.cat((torch.ones(1), (1 - sure).cumprod(0)[:-1]))
            explained.append(float(((sure * passed) @ colors - found[y, x]).abs().max()))
        assert min(explained) < 2e-5
