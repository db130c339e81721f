"""Feature maps of VGG16 and AlexNet, from weights files: with their own pooling, or shift-tolerant.

`n` pictures of `h w` pixels, `c` channels of `y x` positions.

The shift-tolerant networks (Ghildyal and Liu 2022, "Shift-tolerant Perceptual Similarity Metric")
divide every stride of 2 in a stride of 1 and a blur with stride 2 (Zhang 2019), with borders of
two reflected pixels. Their files are state dicts with the names `net.slice1.0.weight` ...
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError

VGG16 = {
    "relu1_1": (0, 3, 64),
    "relu1_2": (2, 64, 64),
    "relu2_1": (5, 64, 128),
    "relu2_2": (7, 128, 128),
    "relu3_1": (10, 128, 256),
    "relu3_2": (12, 256, 256),
    "relu3_3": (14, 256, 256),
    "relu4_1": (17, 256, 512),
    "relu4_2": (19, 512, 512),
    "relu4_3": (21, 512, 512),
    "relu5_1": (24, 512, 512),
    "relu5_2": (26, 512, 512),
    "relu5_3": (28, 512, 512),
}
"""The 13 convolutions (3x3, padding 1): number in torchvision's `features`, channels in and out.
Configuration D of Simonyan and Zisserman 2015; a 2x2 maximum pool before each `reluN_1`, N > 1."""
STYLE_LAYERS = ("relu1_2", "relu2_2", "relu3_3", "relu4_3")
"""The style layers of Johnson et al. 2016, whom the paper cites for its Gram matrix."""
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
"""How all of these weights want RGB in [0, 1] to be standardised."""
BINOMIAL = (1 / 4, 2 / 4, 1 / 4)
BORDER = 2
"""Pixels reflected on every side before a blur, which the weights were trained with."""


class Vgg16:
    """Feature maps of a local VGG16: torchvision's state dict, or the shift-tolerant one, as .pth
    or .safetensors. The tensors' names tell which."""

    def __init__(self, path: str | Path, layers: Sequence[str] = STYLE_LAYERS) -> None:
        """Reads the convolutions up to the deepest of `layers`. Raises InputError, UsageError."""
        unknown = [name for name in layers if name not in VGG16]
        if unknown or not layers:
            raise UsageError(
                f"VGG16 has no layer {', '.join(unknown) or '(none given)'}; choose from: "
                f"{', '.join(VGG16)}."
            )
        self.layers = tuple(name for name in VGG16 if name in layers)
        depth = list(VGG16).index(self.layers[-1]) + 1
        weights = WeightsFile(path, "torchvision's vgg16-397923af.pth")
        self.shift_tolerant = "net.slice1.0.weight" in weights.state
        self.convolutions = {
            name: weights.convolution(self._key(name, number), (outputs, inputs, 3, 3))
            for name, (number, inputs, outputs) in list(VGG16.items())[:depth]
        }

    def _key(self, name: str, number: int) -> str:
        """The name of a convolution in the file. The shift-tolerant network has one module more,
        the blur, at each pooling before it."""
        block = int(name[4])
        return (
            f"net.slice{block}.{number + block - 1}"
            if self.shift_tolerant
            else (f"features.{number}")
        )

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The chosen layers, shallow first. Each pooling halves the sides: relu4 needs 8 pixels."""
        x, layers = standardised(images), []
        for name, (weight, bias) in self.convolutions.items():
            if name.endswith("_1") and name != "relu1_1":
                x = blur_pool(F.max_pool2d(x, 2, 1)) if self.shift_tolerant else F.max_pool2d(x, 2)
            x = F.conv2d(x, weight.to(x), bias.to(x), padding=1).relu()
            if name in self.layers:
                layers.append(x)
        return layers


ALEXNET = {
    "relu1": ("net.slice1.0", (64, 3, 11, 11), 2),
    "relu2": ("net.slice2.5", (192, 64, 5, 5), 2),
    "relu3": ("net.slice3.9", (384, 192, 3, 3), 1),
    "relu4": ("net.slice4.11", (256, 384, 3, 3), 1),
    "relu5": ("net.slice5.13", (256, 256, 3, 3), 1),
}
"""Its convolutions: name in the file, shape, padding (Krizhevsky 2014)."""
POOLED = ("relu2", "relu3")
"""The layers before which there is a 3x3 maximum pool."""


class ShiftTolerantAlexNet:
    """All five feature maps of the shift-tolerant AlexNet; its first convolution has stride 1 and
    a blur with stride 2 behind it."""

    def __init__(self, path: str | Path) -> None:
        """Read the weights from a file. Raises InputError."""
        weights = WeightsFile(path, "alex_shift_tolerant.pth of stlpips_pytorch")
        self.convolutions = {
            name: (*weights.convolution(key, shape), padding)
            for name, (key, shape, padding) in ALEXNET.items()
        }

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The layers, shallow first, of pictures of 32 pixels or more a side."""
        x, layers = standardised(images), []
        for name, (weight, bias, padding) in self.convolutions.items():
            if name in POOLED:
                x = blur_pool(F.max_pool2d(x, 3, 1))
            x = F.conv2d(x, weight.to(x), bias.to(x), padding=padding)
            x = (blur_pool(x) if name == "relu1" else x).relu()
            layers.append(x)
        return layers


def standardised(images: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n 3 h w"]:
    """Pictures in [0, 1] as the networks want them."""
    mean, std = (images.new_tensor(s)[:, None, None] for s in (IMAGENET_MEAN, IMAGENET_STD))
    return (images - mean) / std


def blur_pool(x: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c y x"]:
    """A 3x3 binomial blur with stride 2, behind reflected borders; a side h becomes
    (h + 1) // 2 + 1."""
    kernel = torch.outer(x.new_tensor(BINOMIAL), x.new_tensor(BINOMIAL))
    channels = x.shape[1]
    bordered = F.pad(x, (BORDER,) * 4, mode="reflect")
    return F.conv2d(bordered, kernel.expand(channels, 1, 3, 3), stride=2, groups=channels)


class WeightsFile:
    """The tensors of a .pth or .safetensors; nothing in it is executed."""

    def __init__(self, path: str | Path, wanted: str) -> None:
        """`wanted`: the file that the message of an error advises. Raises InputError."""
        self.path, self.wanted = Path(path), wanted
        self.state = self._read()

    def _read(self) -> Mapping[str, object]:
        path, hint = self.path, f"give {self.wanted} or a .safetensors of the same tensors"
        if not path.is_file():
            raise InputError(f"{path}: no such file; {hint}.")
        try:
            if path.suffix == ".safetensors":
                from safetensors.torch import load_file

                return load_file(path)
            state = torch.load(path, map_location="cpu", weights_only=True)
        except Exception as error:  # a broken or hostile file can fail anywhere in the unpickler
            reason = str(error).partition("\n")[0][:120]
            raise InputError(f"{path}: not a readable weights file ({reason}); {hint}.") from error
        if not isinstance(state, dict):
            raise InputError(f"{path}: holds a {type(state).__name__}, not a state dict; {hint}.")
        return state

    def convolution(
        self, name: str, shape: tuple[int, ...]
    ) -> tuple[Float[Tensor, "o i k k"], Float[Tensor, " o"]]:
        """(weight, bias) of a convolution of that shape; InputError if it has another."""
        return self.tensor(f"{name}.weight", shape), self.tensor(f"{name}.bias", shape[:1])

    def tensor(self, key: str, shape: tuple[int, ...]) -> Float[Tensor, "..."]:
        """A tensor of that name and shape, float32; InputError if it is not there."""
        tensor = self.state.get(key)
        if not isinstance(tensor, Tensor):
            raise InputError(
                f"{self.path}: has no tensor {key}; are these the weights of {self.wanted}, with "
                "their names?"
            )
        if tuple(tensor.shape) != shape:
            raise InputError(
                f"{self.path}: {key} is {tuple(tensor.shape)}, not {shape}; is it another network?"
            )
        return tensor.float()
