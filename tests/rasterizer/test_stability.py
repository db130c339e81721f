"""The edge cases: finite pictures and gradients, or a ValueError that names input and row."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import pytest
import torch
from closeness import EPS32, leaves, relative, tensors, weights_like

from gsedit.bench.renderer import stability
from gsedit.bench.renderer.stability import CROWD, EDGE_CASES, camera, gaussian
from rasterizer import Execution, Numerics, Rendering, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.numerics import Kernel

DTYPES = (torch.float32, torch.float64)


BY_NAME = {case.name: case for case in EDGE_CASES}


ROUNDING = CROWD * EPS32
"""Error of a color in [0, 1]: a rounding for each Gaussian that one pixel can blend."""


DRAWN = [case.name for case in EDGE_CASES if case.refused is None]


# What float32 cannot give, and why. Everything else keeps the promise of 2e-4.
GRADIENTS_32 = {
    # z moves its center by 1e7 pixels and its width by as much: what is left is 1e-6 of both
    "scale 1e6 far aside": 1e6 * EPS32,
    # the one pixel is 0.1 from each center: the gradient of the shape, 0.01 pixel^2, is a
    # difference of terms of the tile's corner, 12 pixel^2
    "100,000 layers": 1e-2,
    # the largest float is less than the gradient of the row, which is 0 instead
    "denormal quaternion": 1.001,
}


# Where float64 and its reference differ by more than a few roundings, and why.
ERRORS_64 = {
    # the reference's determinant is a difference of 1e13 and 1e13 pixels^4
    "needle 1e3 : 1e-3": 1e-6,
    "needle of 1000 pixels": 1e-10,
    # eps * 1e7 is 2e-9 of a standard deviation
    "1e7 from the origin": 1e-8,
}


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", BY_NAME)
def test_every_edge_case_is_right_or_refused_by_name(name, dtype):
    case = BY_NAME[name]
    row = stability.measure_edge_case(case, dtype, Execution(kernel="torch"))
    if case.refused is not None:
        assert row.outcome == "refused"
        assert re.match(case.refused, row.message)
        return
    assert row.outcome == "finite"
    if dtype == torch.float32:
        assert row.image_error < 2e-5
        assert row.gradient_error < GRADIENTS_32.get(name, 2e-4)
    else:
        assert row.image_error < ERRORS_64.get(name, 1e-12)
        assert row.gradient_error < ERRORS_64.get(name, 1e-9)


Drawn = tuple[Rendering, tuple[torch.Tensor, ...]]


def draw(name: str, dtype: torch.dtype, numerics: Numerics, kernel: Kernel = "torch") -> Drawn:
    """All that a picture has, and the gradients of a loss of all of it, by every input."""
    scene, view, background = BY_NAME[name].make(dtype)
    inputs, pose = leaves(scene), view.world_to_camera.clone().requires_grad_()
    picture = render(
        inputs,
        replace(view, world_to_camera=pose),
        background=background.requires_grad_(),
        depth=True,
        median_depth=True,
        numerics=numerics,
        execution=Execution(kernel=kernel),
    )
    loss = sum((part * weights_like(part)).sum() for part in visible_parts(picture))
    return picture, torch.autograd.grad(loss, (*tensors(inputs), pose, background))


def visible_parts(picture: Rendering) -> tuple[torch.Tensor, ...]:
    return picture.color, picture.alpha, picture.depth


@cache
def draw_all(name: str, dtype: torch.dtype) -> Drawn:
    return draw(name, dtype, stability.WITHOUT_STOP)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", DRAWN)
def test_depths_alphas_and_their_gradients_are_finite(name, dtype):
    drawn = [draw_all(name, dtype)]
    if name != "100,000 layers":  # takes seconds
        drawn.append(draw(name, dtype, Numerics()))
    for picture, gradients in drawn:
        parts = (*visible_parts(picture), picture.median_depth, *gradients)
        assert all(part.isfinite().all() for part in parts)
        assert ((picture.alpha >= 0) & (picture.alpha <= 1)).all()


@pytest.mark.skipif(compiled.load() is None, reason="no C++ compiler compiles the kernel here")
@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", DRAWN)
def test_the_compiled_kernel_draws_every_edge_case_like_torch(name, dtype):
    wanted, exact = draw_all(name, dtype)
    found, gradients = draw(name, dtype, stability.WITHOUT_STOP, kernel="compiled")
    # each is within its bar of the reference, so within twice that of each other
    picture_bar, gradient_bar = (4e-5, 4e-4) if dtype == torch.float32 else (1e-11, 1e-9)
    brightest = max(1.0, float(wanted.color.detach().max()))
    assert (found.color - wanted.color).abs().max() < picture_bar * brightest
    assert (found.alpha - wanted.alpha).abs().max() < picture_bar
    if dtype == torch.float32:
        gradient_bar = 2 * GRADIENTS_32.get(name, gradient_bar / 2)
    for a, b in zip(gradients, exact):
        assert a.isfinite().all()
        # what passes 100,000 layers is 0, or denormal
        assert relative(a, b) < gradient_bar or b.norm() < 1e-30


HIDDEN = {
    "behind the camera", "in the camera's plane", "at the near plane", "1e-6 before the near plane",
    "opacity 0", "logit -50",
}  # fmt: skip


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_extreme_rows_are_drawn_unless_they_are_hidden(dtype):
    hidden = set()
    for name in DRAWN:
        scene, view, background = BY_NAME[name].make(dtype)
        if len(scene) != CROWD + 1:  # not one among many
            continue
        rest = scene[torch.arange(CROWD + 1) != CROWD // 2]
        with_it, without = (render(s, view, background=background).color for s in (scene, rest))
        # another number of Gaussians is a product of another shape: it may round otherwise
        difference = (with_it - without).abs().max()
        if difference <= ROUNDING:
            hidden.add(name)
        else:  # it shows: more than rounding would
            assert difference > 1e-2
    assert hidden == HIDDEN


def test_scales_are_drawn_up_to_a_limit_and_refused_beyond_it():
    """1e-38 to 1e38 in float32: the limit is one, and above what any scene holds."""
    refusals: list[str] = []
    for exponent in range(-38, 39, 2):
        scene = gaussian((0.1, 0.0, 2.0), (10.0**exponent,) * 3).to(torch.float32)
        inputs = leaves(scene)
        try:
            picture = render(inputs, camera()).color
        except ValueError as error:
            refusals.append(str(error))
            continue
        assert not refusals  # what is refused stays refused
        gradients = torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))
        assert all(part.isfinite().all() for part in (picture, *gradients))
        if exponent >= 6:  # covers the picture evenly: its opacity times its color
            assert (picture - 0.7 * picture.new_tensor((0.8, 0.4, 0.2))).abs().max() < 1e-5
        largest = exponent
    assert largest >= 16
    assert refusals
    assert all(text.startswith("log_scales[0] is out of range: its varia") for text in refusals)
