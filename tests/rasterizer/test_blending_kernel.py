"""The blending kernel's own cases: widths of vectors, pixels that are finished, any features."""

from __future__ import annotations

import ctypes

import pytest
import torch
from closeness import leaves, relative, tensors, weights_like
from scenes import camera, cloud, gaussian

from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from gsedit.bench.synthetic.gallery import columns
from rasterizer import Execution, Numerics, compiled, compiler, concatenate, render
from rasterizer.blending import cpp_backend

TORCH, COMPILED = Execution(kernel="torch"), Execution(kernel="compiled")
WHOLE_SUM = Numerics(transmittance_min=0.0)
LEFT_OUT = 0.2 * Numerics().transmittance_min
"""Most that passes a closed block of pixels (CLOSED in kernel.cpp), of vectors of any width."""
OPACITY_BAR = 2 * LEFT_OUT / (1 - Numerics().alpha_max)
"""Relative error of an opacity's gradient: the part left out, divided by what a disc lets through.
Twice that, since blocks of narrow vectors close sooner (1.0e-4 at 512 bits, 2.6e-4 at 128)."""
pytestmark = pytest.mark.skipif(cpp_backend.load() is None, reason="no C++ compiler here")


def gradients(scene, view, execution, numerics=WHOLE_SUM, *, depth=False):
    inputs = leaves(scene)
    drawn = render(inputs, view, execution=execution, numerics=numerics, depth=depth)
    loss = (drawn.color * weights_like(drawn.color)).sum()
    loss = loss + (drawn.alpha * weights_like(drawn.alpha, 1)).sum()
    if drawn.depth is not None:
        loss = loss + (drawn.depth * weights_like(drawn.depth, 2)).sum()
    return drawn, torch.autograd.grad(loss, tensors(inputs))


@pytest.mark.parametrize("level", compiled.levels(), ids=lambda level: level.name)
def test_every_width_of_vectors_draws_the_same(level, tmp_path, monkeypatch):
    if level not in compiled.usable_levels():
        pytest.skip(f"this processor has no {level.name}")
    library = tmp_path / "kernel.so"
    found = compiler.find_compiler()
    compiler.compile_library(found, cpp_backend.SOURCE, library, tunings=[(*level.flags, "-O1")])
    monkeypatch.setattr(cpp_backend, "load", lambda kernel="auto": ctypes.CDLL(str(library)))
    scene, view = cloud()
    wanted, exact = gradients(scene, view, TORCH)
    for dtype, bar in ((torch.float32, 2e-5), (torch.float64, 1e-12)):
        found, close = gradients(scene.to(dtype), view, COMPILED)
        assert (found.color - wanted.color).abs().max() < bar
        for a, b in zip(close, exact):
            assert relative(a, b) < bar


@pytest.mark.parametrize("layers", [4, 40, 400])
def test_what_lies_behind_a_wall_changes_no_gradient_in_front_of_it(layers):
    """The transmittance behind 40 opaque layers is no float, and half of each block is open."""

    def layer(i: int):
        return gaussian((-0.12, 0.0, 2.0 + i / 100), (0.03, 0.03, 0.01), opacity=0.9999)

    veil = gaussian((0.0, 0.1, 1.5), (1.0, 1.0, 0.1), opacity=0.5)
    ground = gaussian((0.0, 0.0, 9.0), (9.0, 9.0, 0.1), opacity=0.7)
    scene = concatenate(veil, *(layer(i) for i in range(layers)), ground)
    wanted, exact = gradients(scene, camera(), TORCH)
    for numerics, bar in ((WHOLE_SUM, 2e-5), (Numerics(), OPACITY_BAR)):
        found, close = gradients(scene.to(torch.float32), camera(), COMPILED, numerics)
        assert (found.color - wanted.color).abs().max() < 2e-5
        for a, b in zip(close, exact):
            assert relative(a, b) < bar


def test_stopping_early_keeps_the_gradients_of_opaque_discs():
    """Blocks of pixels that closed at the whole stop would leave out five times as much."""
    scene = surface_gaussians(columns(), 15_000, torch.Generator().manual_seed(0)).to(torch.float64)
    (view,) = ring_cameras(columns(), 1, 128)
    wanted, exact = gradients(scene, view, COMPILED)
    found, close = gradients(scene, view, COMPILED, Numerics())
    assert (found.alpha - wanted.alpha).abs().max() < LEFT_OUT
    assert (found.color - wanted.color).abs().max() < LEFT_OUT
    for a, b in zip(close, exact):
        assert relative(a, b) < OPACITY_BAR


def behind_a_wall():
    """A red disc of which a hundredth and some shows, behind an opaque one, and one beside them."""
    wall = gaussian((0.0, 0.0, 2.0), (0.5, 0.5, 0.01), opacity=0.99)
    hidden = gaussian((0.0, 0.0, 3.0), (0.1, 0.1, 0.01), opacity=0.9)
    return concatenate(wall, hidden, gaussian((0.6, 0.0, 2.5), (0.1, 0.1, 0.1), opacity=0.8))


@pytest.mark.parametrize("execution", [TORCH, COMPILED], ids=["torch", "compiled"])
def test_what_carries_too_little_gets_no_gradient_and_shows_all_the_same(execution):
    """Adam would move it as far as what is seen."""
    scene = behind_a_wall()
    whole, every = gradients(scene, camera(), execution)
    felt = Numerics(transmittance_min=0.0, gradient_min=0.02)
    drawn, few = gradients(scene, camera(), execution, felt)
    assert torch.equal(drawn.color, whole.color)
    assert all((gradient[1] != 0).any() for gradient in every[2:])
    assert all((gradient[1] == 0).all() for gradient in few)
    assert all((gradient[0] != 0).any() and (gradient[2] != 0).any() for gradient in few[2:])


@pytest.mark.parametrize("least", [0.0, 1 / 1024, 1 / 16])
def test_both_kernels_leave_out_the_same_gradients(least):
    scene, view = cloud()
    numerics = Numerics(transmittance_min=0.0, gradient_min=least)
    drawn, wanted = gradients(scene, view, TORCH, numerics, depth=True)
    again, found = gradients(scene, view, COMPILED, numerics, depth=True)
    assert (drawn.depth - again.depth).abs().max() < 1e-11
    _, whole = gradients(scene, view, TORCH, depth=True)
    for a, b, c in zip(found, wanted, whole):
        assert relative(a, b) < 1e-11
        assert (relative(b, c) > 1e-6) == (least > 0)
