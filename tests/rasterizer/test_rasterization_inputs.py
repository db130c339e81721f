"""`rasterization` of covariances, features, harmonics, several cameras and batches."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import pytest
import torch
from closeness import assert_near, leaves, relative
from gsplat_call import BACKGROUND, DTYPES, cloud, gsplat_arguments, loss_of
from scenes import camera, random_cloud

from rasterizer import rasterization
from rasterizer.numerics import SH_DC
from rasterizer.project import rotation_matrices
from rasterizer.reference import render_reference


@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("columns", [6, 9])
def test_covars_are_quats_and_scales(columns, mode):
    scene = leaves(cloud())
    arguments = gsplat_arguments(scene, camera())
    axes = rotation_matrices(scene.quats) * scene.scales[:, None, :]
    covars = axes @ axes.mT
    if columns == 6:
        covars = covars[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]
    given = arguments | {"quats": None, "scales": None, "covars": covars}
    pictures = [rasterization(**a, rasterize_mode=mode)[0] for a in (arguments, given)]
    assert (pictures[0] - pictures[1]).abs().max() < 1e-9
    of = (scene.quats, scene.log_scales)
    wanted, found = (torch.autograd.grad(loss_of(p, p), of, retain_graph=True) for p in pictures)
    for a, b in zip(found, wanted):
        assert relative(a, b) < 1e-8


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_covars_may_be_singular(mode, dtype):
    """A point, a line and a disc have no Cholesky factor of full rank."""
    scene = random_cloud(3, seed=8)
    flat = torch.tensor([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0]], dtype=torch.float64)
    axes = rotation_matrices(scene.quats) * flat[:, None, :]
    scene = scene.to(dtype)
    arguments = gsplat_arguments(scene, camera()) | {
        "scales": flat.to(dtype),
        "rasterize_mode": mode,
    }
    covars = (axes @ axes.mT).to(dtype).requires_grad_()
    means = scene.means.clone().requires_grad_()
    wanted, _, _ = rasterization(**arguments)
    found, _, _ = rasterization(**arguments | {"covars": covars, "means": means})
    eps = torch.finfo(dtype).eps
    # exponents up to 5.5 of covariances of condition 100 (6 pixels long, blurred by 0.3); of
    # antialiased lines the visible part is the root of a determinant that is 0 but for rounding
    bar = sqrt(eps) if mode == "antialiased" else 5.5 * 100 * eps
    assert (found - wanted).abs().max() < bar
    loss_of(found, found).backward()
    assert covars.grad is not None
    assert covars.grad.isfinite().all()
    assert covars.grad[1:].abs().sum() > 0
    assert means.grad is not None
    assert means.grad.isfinite().all()


def test_gradcheck_of_covars():
    scene = random_cloud(4, seed=5)
    view = camera(9, 7, focal=8.0)
    arguments = gsplat_arguments(replace(scene, logit_opacities=torch.zeros(4).double()), view)
    axes = rotation_matrices(scene.quats) * (scene.scales + 0.2)[:, None, :]
    covars = (axes @ axes.mT).requires_grad_()

    def picture(covars):
        return rasterization(**arguments, covars=covars, rasterize_mode="antialiased")[0]

    assert torch.autograd.gradcheck(picture, (covars,), fast_mode=True)


@pytest.mark.parametrize("channels", [1, 2, 7, 32])
def test_features_of_any_number_of_channels(channels):
    scene, view = cloud(0), camera()
    generator = torch.Generator().manual_seed(channels)
    features = torch.rand(60, channels, generator=generator, dtype=torch.float64)
    arguments = gsplat_arguments(scene, view) | {"colors": features, "sh_degree": None}
    color, _, _ = rasterization(**arguments)
    assert color.shape == (1, 32, 40, channels)
    padded = torch.nn.functional.pad(features, (0, -channels % 3))
    for i, columns in enumerate(padded.split(3, dim=1)):
        painted = replace(scene, sh=((columns - 0.5) / SH_DC)[:, None])
        wanted = render_reference(painted, view).color[..., : channels - 3 * i]
        assert (color[0, ..., 3 * i : 3 * i + 3] - wanted).abs().max() < 1e-9


@pytest.mark.parametrize("degree", range(5))
def test_harmonics_up_to_a_degree(degree):
    scene = random_cloud(60, seed=3, degree=4)
    cut = replace(scene, sh=scene.sh[:, : (degree + 1) ** 2])
    color, _, _ = rasterization(**gsplat_arguments(scene, camera()) | {"sh_degree": degree})
    assert (color[0] - render_reference(cut, camera()).color).abs().max() < 1e-9


def test_cameras_and_batches_are_pictures_of_their_own():
    views = camera(), replace(camera(), fx=60.0, cx=25.0)
    scenes = cloud(), random_cloud(60, seed=4, degree=2)
    generator = torch.Generator().manual_seed(0)
    backgrounds = torch.rand(2, 2, 3, generator=generator, dtype=torch.float64)
    one = [gsplat_arguments(scene, *views) for scene in scenes]
    stacked = {
        name: torch.stack([a[name] for a in one]) if torch.is_tensor(value) else value
        for name, value in one[0].items()
    }
    stacked["means"].requires_grad_()
    options = {"render_mode": "RGB+ED"}
    color, alpha, meta = rasterization(**stacked, **options, backgrounds=backgrounds)
    assert color.shape == (2, 2, 32, 40, 4)
    assert alpha.shape == (2, 2, 32, 40, 1)
    assert (meta["n_batches"], meta["n_cameras"]) == (2, 2)
    color.sum().backward()
    for b, scene in enumerate(scenes):
        for c, view in enumerate(views):
            means = scene.means.clone().requires_grad_()
            alone, _, own = rasterization(
                **gsplat_arguments(scene, view) | {"means": means},
                **options,
                backgrounds=backgrounds[b, c][None],
            )
            alone.sum().backward()
            assert_near(alone[0], color[b, c], 1e-12)
            for name in ("means2d", "radii", "depths", "conics", "opacities"):
                assert_near(own[name][0], meta[name][b, c], 1e-12)
            assert_near(own["means2d"].grad[0], meta["means2d"].grad[b, c], 1e-9)


@pytest.mark.parametrize("harmonic", [False, True])
def test_colors_may_differ_by_camera(harmonic):
    views = camera(), replace(camera(), cx=25.0)
    scene = cloud()
    painted = torch.stack((scene.sh, scene.sh.flip(0)))
    degree = 2
    if not harmonic:
        painted, degree = painted[:, :, 0], None
    arguments = gsplat_arguments(scene, *views) | {"sh_degree": degree}
    color, _, _ = rasterization(**arguments | {"colors": painted})
    for i, view in enumerate(views):
        own = gsplat_arguments(scene, view) | {"sh_degree": degree, "colors": painted[i]}
        assert_near(color[i], rasterization(**own)[0][0], 1e-12)


def test_gradients_of_features_backgrounds_and_opacities():
    """The picture is linear in the first two; of the third, finite differences."""
    scene, view = cloud(0), camera()
    arguments = gsplat_arguments(scene, view) | {"sh_degree": None}
    features = (0.5 + SH_DC * scene.sh[:, 0]).requires_grad_()
    background = BACKGROUND[None].clone().requires_grad_()
    opacities = scene.opacities.requires_grad_()

    def loss(features, background, opacities):
        changed = {"colors": features, "backgrounds": background, "opacities": opacities}
        return loss_of(*rasterization(**arguments | changed)[:2])

    inputs = (features, background, opacities)
    gradients = torch.autograd.grad(loss(*inputs), inputs)
    generator = torch.Generator().manual_seed(1)
    for i, (value, gradient) in enumerate(zip(inputs, gradients)):
        step = torch.randn(value.shape, generator=generator, dtype=torch.float64) * 1e-7
        up, down = (loss(*inputs[:i], value + s * step, *inputs[i + 1 :]) for s in (1, -1))
        assert (up - down).item() / 2 == pytest.approx((gradient * step).sum().item(), rel=1e-5)
