"""The loss of a fit to photos, (1 - w) L1 + w D-SSIM: `photometric.cpp`, or where that cannot be
compiled the definition, `gsedit.measures.losses`, equal to rounding."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsedit.measures import losses
from rasterizer.compiled import function
from rasterizer.compiled import load as load_library

SOURCE = Path(__file__).with_suffix(".cpp")
SMALLEST = 6
"""Pixels a side: the window is reflected at borders."""


class _Job(ctypes.Structure):
    """Argument `Job` of photometric.cpp."""

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
    if not image.numel():
        raise ValueError(f"pictures of {tuple(image.shape)}: there is none to compare")
    if min(image.shape[-3:-1]) < SMALLEST:
        raise ValueError(f"pictures of {tuple(image.shape)}: SSIM needs sides of {SMALLEST} pixels")
    if compiled and _accepts(image, target):
        return _Photometric.apply(image, target, dssim_weight)
    l1, dssim = losses.l1(image, target), losses.dssim(image, target)
    return (1 - dssim_weight) * l1 + dssim_weight * dssim


def _accepts(image: Tensor, target: Tensor) -> bool:
    return (
        image.dtype == target.dtype
        and image.dtype in (torch.float32, torch.float64)
        and image.shape == target.shape
        and not target.requires_grad
        and image.device.type == target.device.type == "cpu"
        and load() is not None
    )


def load() -> ctypes.CDLL | None:
    """The kernel; None where it cannot be compiled."""
    return load_library(SOURCE)


class _Photometric(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(ctx: Any, image: Tensor, target: Tensor, weight: float) -> Tensor:
        image, target = image.contiguous(), target.contiguous()
        gradient = torch.empty_like(image) if ctx.needs_input_grad[0] else None
        value = _by_kernel(image, target, weight, gradient)
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return gradient * grad_outputs[0], None, None


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


def supervised(
    picture: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None,
) -> tuple[Float[Tensor, "*n h w 3"], Float[Tensor, "*n h w 3"]]:
    """The picture and its target, both with the picture's own colors where the mask is False.

    Any loss of the two is then free of gradients there and of what the photo has there; a window of
    SSIM that reaches across the border compares what lies inside only. Every pixel inside weighs
    what it weighs in a photo without a mask.
    """
    if mask is None:
        return picture, target
    drawn, inside = picture.detach(), mask[..., None]
    return torch.where(inside, picture, drawn), torch.where(inside, target, drawn)
