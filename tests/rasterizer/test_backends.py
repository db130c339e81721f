"""One place chooses what blends, and a backend is a record that anything can fill."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import leaves, tensors, weights_like
from scenes import cloud

from rasterizer import Execution, render
from rasterizer.blending import choose, cpp_backend, torch_backend


def gradients(execution):
    scene, camera = cloud()
    inputs = leaves(scene)
    picture = render(inputs, camera, execution=execution).color
    return picture, torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))


@pytest.mark.parametrize("kernel", [None, object()])
def test_the_compiled_backend_is_chosen_where_it_is_asked_for_and_works(kernel, monkeypatch):
    monkeypatch.setattr(cpp_backend, "load", lambda: kernel)
    compiled = choose.choose_backend(Execution(compile=True)).name
    assert compiled == ("torch" if kernel is None else "cpp")
    assert choose.choose_backend(Execution()).name == "torch"


def test_a_backend_of_ones_own_blends_both_ways(monkeypatch):
    wanted, exact = gradients(Execution(block=8))
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
        accepts=lambda execution: execution.block == 8,
        forward=forward,
        backward=backward,
    )
    monkeypatch.setattr(choose, "BACKENDS", (own, *choose.BACKENDS))
    picture, found = gradients(Execution(block=8))
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
