"""The photometric loss is the definition, with the kernel and without, and so is its gradient."""

import pytest
import torch

from gsedit.capture.fitting import photometric
from gsedit.measures import losses

SHAPES = [(6, 6, 3), (6, 31, 3), (37, 6, 3), (13, 12, 3), (2, 4, 20, 17, 3)]
"""The smallest pictures, where reflections overlap; ordinary ones; stacks of them."""


@pytest.fixture(params=["definition", "compiled"])
def compiled(request):
    if request.param == "compiled" and photometric.load() is None:
        pytest.skip("no C++ compiler on this machine")
    return request.param == "compiled"


def pictures(shape, dtype=torch.float64):
    """A picture and its target, with places where they are equal."""
    random = torch.Generator().manual_seed(0)
    target = torch.rand(*shape, generator=random, dtype=torch.float64)
    noise = torch.randn(*shape, generator=random, dtype=torch.float64)
    image = torch.where(noise > 1, target, target + 0.1 * noise)
    return image.to(dtype), target.to(dtype)


def value_and_gradient(image, target, weight=0.2, *, compiled):
    return differentiated(
        lambda leaf: photometric.photometric(leaf, target, weight, compiled=compiled), image
    )


def defined(image, target, weight=0.2):
    """By L1 and SSIM as they are defined, and autograd."""
    return differentiated(
        lambda leaf: (1 - weight) * losses.l1(leaf, target) + weight * losses.dssim(leaf, target),
        image,
    )


def differentiated(loss_of, image):
    leaf = image.clone().requires_grad_()
    loss = loss_of(leaf)
    (gradient,) = torch.autograd.grad(3 * loss, leaf)
    return loss.detach(), gradient


@pytest.mark.parametrize(("threads", "weight"), [(1, 0.2), (3, 0.2), (1, 1e-3), (1, 1.0)])
@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_the_definition(shape, threads, weight, compiled):
    image, target = pictures(shape)
    before = torch.get_num_threads()
    wanted, exact = defined(image, target, weight)
    try:
        torch.set_num_threads(threads)
        found, close = value_and_gradient(image, target, weight, compiled=compiled)
    finally:
        torch.set_num_threads(before)
    assert abs(found - wanted) < 1e-14
    assert (close - exact).abs().max() < 1e-13 * exact.abs().max()


def test_float32_is_as_close_as_the_definition_is(compiled):
    image, target = pictures((40, 33, 3))
    _, exact = defined(image, target)
    found, close = value_and_gradient(image.float(), target.float(), compiled=compiled)
    _, single = defined(image.float(), target.float())
    assert found.dtype == close.dtype == torch.float32
    error, single_error = ((each.double() - exact).norm() for each in (close, single))
    assert error <= 2 * single_error


@pytest.mark.parametrize(
    ("shape", "told"), [((5, 9, 3), "needs sides of 6"), ((0, 9, 9, 3), "there is none")]
)
def test_pictures_below_the_window_and_none_are_refused(shape, told, compiled):
    image, target = pictures(shape)
    with pytest.raises(ValueError, match=told):
        photometric.photometric(image, target, 0.2, compiled=compiled)
