"""Float32 errors above rounding are alphas that round to the other side of the floor 1/255."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
import torch
from closeness import EPS32
from render_gradients import SEEDS, WHOLE_SUM
from scenes import camera as view_of
from scenes import random_cloud

from rasterizer import Camera, Gaussians, Numerics, render
from rasterizer.numerics import SH_DC
from rasterizer.project import project
from rasterizer.reference import render_reference

# Largest relative error of an alpha near the floor in float32: its exponent is a sum of squares of
# up to 100 (5.5 comes out at the floor), each rounded a few times.
FLOOR_ROUNDING = 400 * EPS32


def on_the_floor(scene: Gaussians, camera: Camera) -> Gaussians:
    """The scene with 80 opacities such that an alpha is 1/255 at some pixel, but for rounding."""
    flat = project(scene, camera, Numerics())
    pixels = camera.pixel_centers().reshape(-1, 2)
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
