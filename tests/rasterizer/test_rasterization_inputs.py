"""`rasterization` of features, harmonics, several cameras and batches."""

from dataclasses import replace

import pytest
import torch
from closeness import assert_near
from gsplat_call import BACKGROUND, cloud, gsplat_arguments, loss_of
from scenes import camera, random_cloud

from rasterizer import rasterization
from rasterizer.numerics import SH_DC
from rasterizer.reference import render_reference


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
            for name in ("means2d", "radii"):
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
