"""`rasterization` draws what the reference draws, by gsplat's names and conventions."""

from dataclasses import replace
from math import ceil, exp, log, sqrt

import pytest
import torch
from closeness import leaves, relative, tensors
from gsplat_call import BACKGROUND, DTYPES, cloud, gsplat_arguments, loss_of, ortho
from scenes import camera, gaussian

from rasterizer import Camera, Numerics, rasterization, render
from rasterizer.reference import render_reference

# option: gsplat's arguments; the same as Numerics; the camera
OPTIONS = {
    "classic": ({}, {}, camera()),
    "near": ({"near_plane": 3.0}, {"near": 3.0}, camera()),
    "far": ({"far_plane": 4.0}, {"far": 4.0}, camera()),
    "eps2d": ({"eps2d": 1.5}, {"blur": 1.5}, camera()),
    "radius_clip": ({"radius_clip": 5.0}, {"radius_clip": 5.0}, camera()),
    "antialiased": ({"rasterize_mode": "antialiased"}, {"antialiased": True}, camera()),
    "ortho": ({"camera_model": "ortho"}, {}, ortho()),
    "ortho from behind": (
        {"camera_model": "ortho", "near_plane": -100.0, "far_plane": -3.5},
        {"near": -100.0, "far": -3.5},
        replace(ortho(), world_to_camera=torch.diag(torch.tensor([1.0, -1, -1, 1])).double()),
    ),
    "all": (
        {
            "near_plane": 2.5,
            "far_plane": 5.5,
            "eps2d": 0.1,
            "radius_clip": 3.0,
            "rasterize_mode": "antialiased",
        },
        {"near": 2.5, "far": 5.5, "blur": 0.1, "radius_clip": 3.0, "antialiased": True},
        camera(),
    ),
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_is_the_references(option, dtype):
    arguments, meaning, view = OPTIONS[option]
    scene, numerics = cloud().to(dtype), Numerics(**meaning)
    wanted = render_reference(scene, view, background=BACKGROUND, numerics=numerics)
    drawn = render(scene, view, background=BACKGROUND, depth=True, numerics=numerics)
    color, alpha, _ = rasterization(
        **gsplat_arguments(scene, view),
        **arguments,
        backgrounds=BACKGROUND.to(dtype)[None],
        render_mode="RGB+ED",
    )
    assert color.dtype == dtype
    assert (color[0, ..., :3] - drawn.color).abs().max() < 4e-6  # opacity is not a logit here
    for found, depth in ((drawn.color, drawn.depth), (color[0, ..., :3], color[0, ..., 3])):
        error = (found.double() - wanted.color).abs()
        # in float32 a splat whose alpha rounds to the other side of the floor is there or not
        flips = error > (1e-9 if dtype == torch.float64 else 1e-4)
        assert flips.double().mean() <= (0 if dtype == torch.float64 else 2e-3)
        assert error[~flips].mean() < 1e-5
        apart = (depth.double() - wanted.depth).abs()[~flips.any(-1)]
        # alpha is at least 1/255, and known to one rounding of 1: depth 6 / alpha loses 255 of them
        assert apart.max() < 6 * 255 * torch.finfo(dtype).eps * 2
    assert 0.02 < alpha.mean() < alpha.max() < 1 - 1e-5


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("option", OPTIONS)
def test_gradients_of_every_option_are_the_references(option, dtype):
    arguments, meaning, view = OPTIONS[option]
    scene, numerics = cloud().to(dtype), Numerics(**meaning)

    def gradients(draw, scene):
        inputs = leaves(scene)
        pose = view.world_to_camera.clone().to(dtype).requires_grad_()
        background = BACKGROUND.clone().to(dtype).requires_grad_()
        color, alpha = draw(inputs, replace(view, world_to_camera=pose), background)
        return torch.autograd.grad(loss_of(color, alpha), (*tensors(inputs), pose, background))

    def reference(scene, view, background):
        found = render_reference(scene, view, background=background, numerics=numerics)
        return found.color, found.alpha

    def ours(scene, view, background):
        found = render(scene, view, background=background, numerics=numerics)
        return found.color, found.alpha

    def theirs(scene, view, background):
        color, alpha, _ = rasterization(
            **gsplat_arguments(scene, view), **arguments, backgrounds=background[None]
        )
        return color[0], alpha[0, ..., 0]

    wanted = gradients(reference, scene.to(torch.float64))
    bar = 1e-3 if dtype == torch.float32 else 1e-8  # as test_render.py
    for draw in (ours, theirs):
        for a, b in zip(gradients(draw, scene), wanted):
            assert relative(a, b) < bar


def test_one_gaussian_by_hand():
    """gsplat's conventions: pixel centers at +0.5, radii by opacity."""
    z, sigma, opacity = 2.0, 0.1, 0.7
    scene = gaussian((0.2, -0.1, z), (sigma,) * 3, opacity=opacity)
    arguments = gsplat_arguments(scene, Camera(torch.eye(4), 50.0, 50.0, 10.0, 8.0, 20, 16))
    x, y = 50 * 0.2 / z + 10, -50 * 0.1 / z + 8
    # an isotropic one seen off the axis: J J^T has the slopes in it
    slope_x, slope_y, scale = 0.1, -0.05, (50 * sigma / z) ** 2
    xx, xy, yy = (1 + slope_x**2) * scale, slope_x * slope_y * scale, (1 + slope_y**2) * scale
    for blur, mode in ((0.3, "classic"), (0.1, "antialiased")):
        color, alpha, meta = rasterization(
            **arguments, eps2d=blur, rasterize_mode=mode, render_mode="RGB+D"
        )
        a, b = xx + blur, yy + blur
        determinant = a * b - xy * xy
        factor = sqrt((xx * yy - xy * xy) / determinant) if mode == "antialiased" else 1.0
        dx, dy = 12.5 - x, 9.5 - y
        conic = (b / determinant, -xy / determinant, a / determinant)
        power = (conic[0] * dx * dx + 2 * conic[1] * dx * dy + conic[2] * dy * dy) / 2
        expected = opacity * factor * exp(-power)
        assert meta["means2d"][0, 0].tolist() == pytest.approx([x, y])
        cut_off = sqrt(2 * log(255 * opacity * factor))
        assert meta["radii"][0, 0].tolist() == [ceil(cut_off * sqrt(v)) for v in (a, b)]
        assert alpha[0, 9, 12, 0].item() == pytest.approx(expected)
        assert color[0, 9, 12].tolist() == pytest.approx([expected * c for c in (0.8, 0.4, 0.2, z)])


@pytest.mark.parametrize("mode", ["RGB", "D", "ED", "RGB+D", "RGB+ED"])
def test_render_modes(mode):
    scene, view = cloud(), camera()
    wanted = render_reference(scene, view, background=BACKGROUND)
    color, alpha, _ = rasterization(
        **gsplat_arguments(scene, view), render_mode=mode, backgrounds=BACKGROUND[None]
    )
    parts = []
    if "RGB" in mode:
        parts.append(wanted.color)
    if mode.endswith("ED"):
        parts.append(wanted.depth[..., None])
    elif mode != "RGB":
        parts.append((wanted.depth * wanted.alpha)[..., None])
    assert (color[0] - torch.cat(parts, -1)).abs().max() < 1e-9
    assert (alpha[0, ..., 0] - wanted.alpha).abs().max() < 1e-9


@pytest.mark.parametrize("dtype", DTYPES)
def test_opacities_of_exactly_0_and_1(dtype):
    scene, view = cloud().to(dtype), camera()
    opacities = scene.opacities.clone()
    opacities[:20], opacities[20:40] = 0.0, 1.0
    opacities.requires_grad_()
    color, alpha, _ = rasterization(**gsplat_arguments(scene, view) | {"opacities": opacities})
    exact = replace(scene, logit_opacities=torch.logit(opacities.detach()))
    wanted = render_reference(exact, view).color
    # with 20 opaque ones a tile may be finished: the stop's 1e-5, and float32
    assert ((color[0] - wanted).abs() > 3e-5).double().mean() < 2e-3
    loss_of(color, alpha).backward()
    assert opacities.grad is not None
    assert opacities.grad.isfinite().all()
    assert not opacities.grad[:20].any()
    assert opacities.grad[20:40].any()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("rows", ["none", "behind"])
def test_nothing_to_see_is_the_background(rows, dtype):
    scene = cloud().to(dtype)
    scene = scene[:0] if rows == "none" else replace(scene, means=-scene.means)
    arguments = gsplat_arguments(leaves(scene), camera())
    for name in ("means", "viewmats"):
        arguments[name] = arguments[name].detach().clone().requires_grad_()
    color, alpha, meta = rasterization(
        **arguments, backgrounds=BACKGROUND.to(dtype)[None], render_mode="RGB+ED"
    )
    assert (color[0, ..., :3] == BACKGROUND.to(dtype)).all()
    assert not color[..., 3].any()
    assert not alpha.any()
    assert meta["means2d"].shape == (1, len(scene), 2)
    (color.sum() + alpha.sum()).backward()
    for tensor in (arguments["means"], arguments["viewmats"], meta["means2d"]):
        assert not tensor.grad.any()
