"""The kernel of the photometric loss gives the loss that torch defines, and its gradient."""

from __future__ import annotations

import pytest
import torch

from gsedit.measures import losses, photometric

SHAPES = [(6, 6, 3), (6, 31, 3), (37, 6, 3), (13, 12, 3), (2, 4, 20, 17, 3)]
"""The smallest pictures, where reflections overlap; ordinary ones; stacks of them."""


@pytest.fixture(autouse=True)
def kernel():
    if photometric.load() is None:
        pytest.skip("no C++ compiler on this machine")


def pictures(shape, dtype=torch.float64):
    """A picture and its target, with places where they are equal."""
    random = torch.Generator().manual_seed(0)
    target = torch.rand(*shape, generator=random, dtype=torch.float64)
    noise = torch.randn(*shape, generator=random, dtype=torch.float64)
    image = torch.where(noise > 1, target, target + 0.1 * noise)
    return image.to(dtype), target.to(dtype)


def value_and_gradient(image, target, weight=0.2, *, compiled):
    leaf = image.clone().requires_grad_()
    loss = photometric.photometric(leaf, target, weight, compiled=compiled)
    (gradient,) = torch.autograd.grad(3 * loss, leaf)
    return loss.detach(), gradient


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_what_torch_defines(shape, threads):
    image, target = pictures(shape)
    before = torch.get_num_threads()
    wanted, exact = value_and_gradient(image, target, compiled=False)
    try:
        torch.set_num_threads(threads)
        found, close = value_and_gradient(image, target, compiled=True)
    finally:
        torch.set_num_threads(before)
    assert abs(found - wanted) < 1e-14
    assert (close - exact).abs().max() < 1e-13 * exact.abs().max()
    torch.testing.assert_close(
        wanted, 0.8 * losses.l1(image, target) + 0.2 * losses.dssim(image, target)
    )


@pytest.mark.parametrize("weight", [1e-3, 1.0])
def test_any_weight(weight):
    image, target = pictures((13, 12, 3))
    wanted, exact = value_and_gradient(image, target, weight, compiled=False)
    found, close = value_and_gradient(image, target, weight, compiled=True)
    assert abs(found - wanted) < 1e-14
    assert (close - exact).abs().max() < 1e-13 * exact.abs().max()


def test_float32_is_as_close_as_torch_is():
    image, target = pictures((40, 33, 3))
    _, exact = value_and_gradient(image, target, compiled=False)
    found, close = value_and_gradient(image.float(), target.float(), compiled=True)
    _, torches = value_and_gradient(image.float(), target.float(), compiled=False)
    assert found.dtype == close.dtype == torch.float32
    error, torches_error = ((each.double() - exact).norm() for each in (close, torches))
    assert error <= 2 * torches_error


def test_strides_and_missing_gradients_do_not_matter():
    image, target = pictures((20, 14, 3))
    turned = image.transpose(0, 1).contiguous().transpose(0, 1)
    wanted = photometric.photometric(image, target, 0.2, compiled=True)
    assert photometric.photometric(turned, target, 0.2, compiled=True) == wanted
    _, gradient = value_and_gradient(turned, target, compiled=True)
    assert torch.equal(gradient, value_and_gradient(image, target, compiled=True)[1])


def test_what_the_kernel_cannot_do_is_left_to_torch():
    image, target = pictures((20, 14, 3))
    moved = target.clone().requires_grad_()
    photometric.photometric(image, moved, 0.2, compiled=True).backward()
    assert moved.grad is not None
    assert photometric.photometric(image, target, 0.0, compiled=True) == losses.l1(image, target)
