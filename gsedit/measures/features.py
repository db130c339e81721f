"""The features of the Gram loss: a fixed filter bank, or VGG16 from torchvision's weights file.

`n` pictures of `h w` pixels, `c` channels of `y x` positions, kernels of `k k` pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from pathlib import Path
from typing import Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError


@runtime_checkable
class FeatureExtractor(Protocol):
    """From pictures to feature maps, one a layer; differentiable in the pictures."""

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The layers of `images`, which are in [0, 1]."""
        ...


# ---- a filter bank -------------------------------------------------------------------------------

OPPONENT = (
    (1 / sqrt(3), 1 / sqrt(3), 1 / sqrt(3)),
    (1 / sqrt(2), -1 / sqrt(2), 0.0),
    (1 / sqrt(6), 1 / sqrt(6), -2 / sqrt(6)),
)
"""Luminance, red - green, yellow - blue: an orthonormal basis of RGB, so no colour counts twice."""
BINOMIAL = (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16)
"""Low-pass before halving (Burt and Adelson 1983)."""
RADIUS = 3  # pixels; a Gaussian of sigma 1 has 0.3 % of its mass beyond
MIN_SIDE = 8  # pixels; an octave of fewer cannot hold a 7-pixel kernel away from its border
SPECTRUM_SIZE = 64  # pixels; the patch on which energies are made equal: the size that is trained


class FilterBank:
    """Gaussian derivatives of opponent colours in octaves: 12 channels an octave, a layer each.

    Blurred colour (3), first derivatives of all three (6), second derivatives of luminance (3);
    derivatives are steerable, so two and three orientations span all. Linear, no weights.
    Each derivative is scaled to pass as much energy of a picture with the 1/f^2 power spectrum of
    natural pictures (Field 1987) as that picture has, and colour is measured from mid-grey: the
    channels of one colour have energies of one order, in every octave. Chroma is not amplified.
    """

    def __init__(self, octaves: int = 4) -> None:
        if octaves < 1:
            raise UsageError(f"A filter bank of {octaves} octaves sees nothing; use 1 or more.")
        self.octaves = octaves
        self.kernels = _kernels()
        self.low_pass = torch.outer(torch.tensor(BINOMIAL), torch.tensor(BINOMIAL))

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n 12 y x"]]:
        """One layer per octave, the finest first; octaves smaller than 8 pixels are left out."""
        if min(images.shape[-2:]) < MIN_SIDE:
            raise UsageError(
                f"A patch of {images.shape[-1]}x{images.shape[-2]} pixels is too small for the "
                f"filter bank; use patches of {MIN_SIDE} pixels or more."
            )
        level, layers = images - 0.5, []
        kernels = self.kernels.to(images)
        low_pass = self.low_pass.to(images).expand(3, 1, -1, -1)
        for _ in range(self.octaves):
            if min(level.shape[-2:]) < MIN_SIDE:
                break
            layers.append(F.conv2d(F.pad(level, (RADIUS,) * 4, mode="reflect"), kernels))
            level = F.conv2d(F.pad(level, (2,) * 4, mode="reflect"), low_pass, stride=2, groups=3)
        return layers


def _kernels() -> Float[Tensor, "12 3 k k"]:
    """Colour and space in one kernel: a single convolution an octave."""
    t = torch.arange(-RADIUS, RADIUS + 1, dtype=torch.float64)
    gauss = torch.exp(-t.square() / 2) / torch.exp(-t.square() / 2).sum()
    first, second = -t * gauss, (t.square() - 1) * gauss
    second = second - gauss * second.sum()  # sampling leaves a mean; a flat picture has no edges
    blur = torch.outer(gauss, gauss)
    slopes = [_equal_energy(torch.outer(*k)) for k in ((gauss, first), (first, gauss))]
    bends = [
        _equal_energy(torch.outer(*k)) for k in ((gauss, second), (first, first), (second, gauss))
    ]
    luminance, *chroma = torch.tensor(OPPONENT, dtype=torch.float64)
    shapes = [(c, k) for c in (luminance, *chroma) for k in (blur, *slopes)]
    shapes += [(luminance, k) for k in bends]
    return torch.stack([c[:, None, None] * k for c, k in shapes])


def _equal_energy(kernel: Float[Tensor, "k k"]) -> Float[Tensor, "k k"]:
    """Scaled to pass the energy of a 1/f^2 picture unchanged (Parseval)."""
    f = torch.fft.fftfreq(SPECTRUM_SIZE, dtype=torch.float64)
    squared = f[:, None].square() + f.square()
    power = torch.where(squared > 0, 1 / squared, 0.0)
    gain = torch.fft.fft2(kernel, s=(SPECTRUM_SIZE, SPECTRUM_SIZE)).abs().square()
    return kernel * (power.sum() / (gain * power).sum()).sqrt()


# ---- VGG16 ---------------------------------------------------------------------------------------

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
"""What torchvision's weights were trained on; RGB in [0, 1]."""


class Vgg16:
    """Feature maps of a local VGG16: torchvision's state dict, as .pth or .safetensors."""

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
        state = _read_state(Path(path))
        self.convolutions = {
            name: (
                _tensor(state, Path(path), f"features.{number}.weight", (outputs, inputs, 3, 3)),
                _tensor(state, Path(path), f"features.{number}.bias", (outputs,)),
            )
            for name, (number, inputs, outputs) in list(VGG16.items())[:depth]
        }

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The chosen layers, shallow first. Each pooling halves the sides: relu4 needs 8 pixels."""
        mean, std = (images.new_tensor(s)[:, None, None] for s in (IMAGENET_MEAN, IMAGENET_STD))
        x, layers = (images - mean) / std, []
        for name, (weight, bias) in self.convolutions.items():
            if name.endswith("_1") and name != "relu1_1":
                x = F.max_pool2d(x, 2)
            x = F.conv2d(x, weight.to(x), bias.to(x), padding=1).relu()
            if name in self.layers:
                layers.append(x)
        return layers


def _read_state(path: Path) -> Mapping[str, object]:
    hint = "give torchvision's vgg16-397923af.pth or a .safetensors of the same tensors"
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


def _tensor(
    state: Mapping[str, object], path: Path, key: str, shape: tuple[int, ...]
) -> Float[Tensor, "..."]:
    tensor = state.get(key)
    if not isinstance(tensor, Tensor):
        raise InputError(
            f"{path}: has no tensor {key}; are these torchvision's VGG16 weights, with their names?"
        )
    if tuple(tensor.shape) != shape:
        raise InputError(
            f"{path}: {key} is {tuple(tensor.shape)}, VGG16 needs {shape}; is it another VGG?"
        )
    return tensor.float()
