"""One place chooses what blends, and a backend is a record that anything can fill."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from functools import partial

import pytest
import torch
from closeness import leaves, relative, tensors, weights_like
from scenes import cloud

from rasterizer import Execution, compiled, render
from rasterizer.blending import choose, cpp_backend, torch_backend


def gradients(execution):
    scene, camera = cloud()
    inputs = leaves(scene)
    picture = render(inputs, camera, execution=execution).color
    return picture, torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))


@pytest.mark.parametrize("library", [None, ctypes.pythonapi])
def test_the_compiled_backend_is_chosen_where_it_works(library, monkeypatch):
    made = compiled.Made(library, "c++", "" if library else "it broke")
    monkeypatch.setattr(compiled, "make", lambda source: made)
    assert choose.is_compiled(Execution()) == (library is not None)
    assert not choose.is_compiled(Execution(kernel="torch"))
    if library is None:
        with pytest.raises(RuntimeError, match="it broke; install"):
            choose.is_compiled(Execution(kernel="compiled"))
    else:
        assert choose.is_compiled(Execution(kernel="compiled"))


@pytest.mark.parametrize(("device", "dtype"), [("cuda", torch.float32), ("cpu", torch.float16)])
def test_the_compiled_backend_takes_only_what_it_can_read(device, dtype, monkeypatch):
    monkeypatch.setattr(cpp_backend, "load", lambda kernel: ctypes.pythonapi)
    execution = Execution(kernel="compiled")
    assert choose.choose_backend(execution, torch.device(device), dtype).name == "torch"


def test_a_backend_may_accept_by_device_or_dtype(monkeypatch):
    calls = []

    def forward(inputs, *args):
        calls.append(inputs.table.dtype)
        return torch_backend.forward(inputs, *args)

    def accepts(execution, device, dtype):
        return device.type == "cuda" or dtype == torch.float32

    own = replace(torch_backend.BACKEND, name="own", accepts=accepts, forward=forward)
    monkeypatch.setattr(choose, "BACKENDS", (own, *choose.BACKENDS))
    scene, camera = cloud()
    for dtype in (torch.float32, torch.float64):
        render(scene.to(dtype), camera)
    assert calls == [torch.float32]
    assert choose.choose_backend(Execution(), torch.device("cuda"), torch.float64) is own


def test_a_backend_of_ones_own_blends_both_ways(monkeypatch):
    wanted, exact = gradients(Execution(tile_size=8, kernel="torch"))
    calls = []

    def forward(*args):
        calls.append("forward")
        return torch_backend.forward(*args)

    def backward(*args):
        calls.append("backward")
        return torch_backend.backward(*args)

    own = replace(
        torch_backend.BACKEND,
        name="own",
        accepts=lambda execution, device, dtype: execution.tile_size == 8,
        forward=forward,
        backward=backward,
    )
    monkeypatch.setattr(choose, "BACKENDS", (own, *choose.BACKENDS))
    picture, found = gradients(Execution(tile_size=8))
    assert calls == ["forward", "backward"]
    assert torch.equal(picture, wanted)
    assert all(torch.equal(a, b) for a, b in zip(found, exact))
    gradients(Execution())
    assert len(calls) == 2  # the others are still chosen


def test_a_pair_that_costs_more_makes_tiles_larger(monkeypatch):
    """With an overhead of ten thousand pixels the fewest pairs are the cheapest."""
    sizes = []

    def forward(inputs, *args):
        sizes.append(inputs.bins.size)
        return torch_backend.forward(inputs, *args)

    scene, camera = cloud()
    for overhead in (0.0, 1e4):
        own = replace(torch_backend.BACKEND, forward=forward, pair_overhead=overhead)
        monkeypatch.setattr(choose, "BACKENDS", (own,))
        render(scene, camera)
    assert sizes[0] < sizes[1] == 32


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16, 21, 64])
def test_running_products_are_those_of_cumprod(count):
    factors = torch.rand(count, 3, 5, generator=torch.Generator().manual_seed(0)).double()
    found = torch.cat((torch.zeros_like(factors[:1]), factors))[1:]  # a view that begins later
    torch_backend.multiply_up(found)
    torch.testing.assert_close(found, factors.cumprod(0), rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("elements", [1, 500, 1 << 12, 1 << 20])
def test_the_size_of_a_batch_changes_nothing(elements, monkeypatch):
    execution = Execution(kernel="torch", tile_size=5)
    wanted, exact = gradients(execution)
    grid = partial(torch_backend.TileGrid, elements=elements)
    monkeypatch.setattr(torch_backend, "TileGrid", grid)
    picture, found = gradients(execution)
    assert (picture - wanted).abs().max() < 1e-12
    assert all(relative(a, b) < 1e-11 for a, b in zip(found, exact))
