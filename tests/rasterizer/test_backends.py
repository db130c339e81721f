"""One place chooses what blends, and a backend is a record that anything can fill."""

from functools import partial

import pytest
import torch
from closeness import leaves, relative, tensors, weights_like
from scenes import cloud

from rasterizer import Execution, render
from rasterizer.blending import torch_backend


def gradients(execution):
    scene, camera = cloud()
    inputs = leaves(scene)
    picture = render(inputs, camera, execution=execution).color
    return picture, torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))


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
