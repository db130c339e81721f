"""The loss of a fit to photos, (1 - w) L1 + w D-SSIM, from torch or from `photometric.cpp`.

`gsedit.measures.losses` is the definition. Both give the same to rounding, and their gradient with
it, without autograd: the window is separable, and four filtered maps are enough.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsedit.measures import losses
from rasterizer.compiled import function
from rasterizer.compiled import load as load_library

SOURCE = Path(__file__).with_suffix(".cpp")
SMALLEST = 6
"""Pixels a side: the window is reflected at borders."""


class _Job(ctypes.Structure):
    """`Job` of photometric.cpp."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ("image", "target")]
        + [(name, ctypes.c_int64)
           for name in ("pictures", "height", "width", "channels", "threads")]
        + [("weight", ctypes.c_double)]
        + [(name, ctypes.c_void_p) for name in ("sums", "gradient")]
    )  # fmt: skip


def photometric(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    dssim_weight: float,
    *,
    compiled: bool = False,
) -> Float[Tensor, ""]:
    """(1 - w) l1 + w dssim of `gsedit.measures.losses`, differentiable in the image; sides of 6
    pixels or more where w is not 0.

    `compiled`: by the C++ kernel, where there is one and it can (on the CPU); equal to rounding.
    """
    if not dssim_weight:
        return losses.l1(image, target)
    if image.dtype != target.dtype or image.shape != target.shape or target.requires_grad:
        l1, dssim = losses.l1(image, target), losses.dssim(image, target)
        return (1 - dssim_weight) * l1 + dssim_weight * dssim
    if not image.numel():
        raise ValueError(f"pictures of {tuple(image.shape)}: there is none to compare")
    if min(image.shape[-3:-1]) < SMALLEST:
        raise ValueError(f"pictures of {tuple(image.shape)}: SSIM needs sides of {SMALLEST} pixels")
    by = _by_kernel if compiled and _accepts(image, target) else _by_torch
    return _Photometric.apply(image, target, dssim_weight, by)


def _accepts(image: Tensor, target: Tensor) -> bool:
    known = image.dtype in (torch.float32, torch.float64)
    return known and image.device.type == target.device.type == "cpu" and load() is not None


def load() -> ctypes.CDLL | None:
    """The kernel; None where it cannot be compiled."""
    return load_library(SOURCE)


class _Photometric(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(
        ctx: Any,
        image: Tensor,
        target: Tensor,
        weight: float,
        by: Callable[[Tensor, Tensor, float, Tensor | None], Tensor],
    ) -> Tensor:
        image, target = image.contiguous(), target.contiguous()
        gradient = torch.empty_like(image) if ctx.needs_input_grad[0] else None
        value = by(image, target, weight, gradient)
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None, None, None]:
        (gradient,) = ctx.saved_tensors
        return gradient * grad_outputs[0], None, None, None


def _by_kernel(image: Tensor, target: Tensor, weight: float, gradient: Tensor | None) -> Tensor:
    """The loss; fills `gradient`, if there is one. Raises MemoryError."""
    kernel = load()
    assert kernel is not None, "ask _accepts() first"
    height, width, channels = image.shape[-3:]
    pictures = image.numel() // max(1, height * width * channels)
    sums = torch.empty(pictures * height, 2, dtype=torch.float64)
    job = _Job(
        image=image.data_ptr(), target=target.data_ptr(), pictures=pictures, height=height,
        width=width, channels=channels, threads=torch.get_num_threads(), weight=weight,
        sums=sums.data_ptr(), gradient=None if gradient is None else gradient.data_ptr(),
    )  # fmt: skip
    if function(kernel, "photometric", image.dtype)(ctypes.byref(job)):
        raise MemoryError(f"no memory to compare pictures of {width}x{height}")
    l1, ssim = (sums.sum(0) / image.numel()).tolist()
    return image.new_tensor((1 - weight) * l1 + weight * (1 - ssim))


# ---- the same in torch ---------------------------------------------------------------------------

REACH, SIGMA = losses.SSIM_WINDOW // 2, 1.5
C1, C2, EPSILON = 0.01**2, 0.03**2, 1e-12
"""SSIM's constants for pictures in [0, 1] (Wang et al. 2004), and what keeps 0 / 0 away."""
BLOCK = 32
"""Filtered rows, or columns, of one product of matrices, from 42: the window as a band matrix."""


def _by_torch(image: Tensor, target: Tensor, weight: float, gradient: Tensor | None) -> Tensor:
    """The loss; fills `gradient`, if there is one."""
    shape = (-1, *image.shape[-3:])
    x, y = (each.view(shape).movedim(-1, 1).contiguous() for each in (image, target))
    mean_x, mean_y, squares, product = _filtered(torch.stack((x, y, x * x + y * y, x * y)))
    both = mean_x * mean_y
    mean_squares = (mean_x * mean_x).addcmul_(mean_y, mean_y)
    a1, a2 = 2 * both + C1, 2 * (product - both) + C2
    b1, b2 = mean_squares + C1, squares - mean_squares + C2
    below = (b1 * b2).add_(EPSILON).reciprocal_()
    ssim = a1 * a2 * below
    difference = x - y
    value = (1 - weight) * difference.abs().mean() + weight * (1 - ssim.mean())
    if gradient is not None:
        by_mean = 2 * below * (mean_y * (a2 - a1) - ssim * mean_x * (b2 - b1))
        slopes = torch.stack((by_mean, ssim * below * b1, a1 * below))
        by_mean, by_square, by_product = _filtered_back(slopes)
        by_ssim = by_mean.addcmul_(x, by_square, value=-2).addcmul_(y, by_product, value=2)
        by_image = difference.sign_().mul_(1 - weight).sub_(by_ssim, alpha=weight)
        gradient.view(shape).copy_(by_image.div_(image.numel()).movedim(1, -1))
    return value


def _filtered(maps: Float[Tensor, "m n c h w"]) -> Float[Tensor, "m n c h w"]:
    """Under SSIM's window; maps are reflected at their borders."""
    flat = torch.nn.functional.pad(maps.flatten(0, 2), (REACH,) * 4, mode="reflect")
    return _under_window(flat).view(maps.shape)


def _filtered_back(maps: Float[Tensor, "m n c h w"]) -> Float[Tensor, "m n c h w"]:
    """The adjoint of `_filtered`."""
    wide = _under_window(torch.nn.functional.pad(maps.flatten(0, 2), (2 * REACH,) * 4))
    for axis in (-1, -2):  # what is beside the picture is added where it was reflected from
        size = wide.shape[axis] - 2 * REACH
        inner = wide.narrow(axis, REACH, size)
        inner.narrow(axis, 1, REACH).add_(wide.narrow(axis, 0, REACH).flip(axis))
        beyond = wide.narrow(axis, REACH + size, REACH).flip(axis)
        inner.narrow(axis, size - 1 - REACH, REACH).add_(beyond)
        wide = inner
    return wide.reshape(maps.shape)


def _under_window(maps: Float[Tensor, "m h w"]) -> Float[Tensor, "m y x"]:
    """Sums under the window, which is symmetric, of every 11 x 11 pixels."""
    offsets = torch.arange(-REACH, REACH + 1, dtype=torch.float64)
    taps = (-0.5 * (offsets / SIGMA).square()).exp()
    band = maps.new_zeros(BLOCK + 2 * REACH, BLOCK)
    for i, tap in enumerate((taps / taps.sum()).tolist()):
        band.diagonal(-i).fill_(tap)

    def blocks(size: int) -> Iterator[tuple[slice, slice, Tensor]]:
        """What goes in, what comes out, and their matrix."""
        for start in range(0, size, BLOCK):
            end = min(start + BLOCK, size)
            wide = end - start + 2 * REACH
            yield slice(start, start + wide), slice(start, end), band[:wide, : end - start]

    count, height, width = maps.shape
    rows, along = maps.view(-1, width), maps.new_empty(count * height, width - 2 * REACH)
    for near, at, matrix in blocks(width - 2 * REACH):
        torch.mm(rows[:, near], matrix, out=along[:, at])
    along = along.view(count, height, -1)
    return torch.cat([m.T @ along[:, near] for near, _, m in blocks(height - 2 * REACH)], 1)
