"""Saliency of pictures, by a published network: U2-Net-p with its weights.

`v` views of `h w` pixels.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate

from gsedit.errors import InputError
from gsedit.selecting.u2net import U2Net

WEIGHTS = Path(__file__).with_name("u2net.safetensors")
SIDE = 320
"""Sides of the square that the network looks at, pixels: it was trained on these."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and deviation of the colors of its training pictures: red, green, blue."""


@torch.no_grad()
def salient(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
    """The probability that each pixel is of what stands out in its picture, in [0, 1].

    Pictures are sRGB in [0, 1]. Raises InputError for weights that are missing or damaged.
    """
    network = load_network()
    size = pictures.shape[1:3]
    x = pictures.float().permute(0, 3, 1, 2)
    x = interpolate(x, (SIDE, SIDE), mode="bilinear", antialias=True).clamp(0, 1)
    x = x / x.amax((1, 2, 3), keepdim=True).clamp_min(1e-6)
    x = (x - x.new_tensor(MEAN)[:, None, None]) / x.new_tensor(DEVIATION)[:, None, None]
    maps = torch.cat([network(each[None]) for each in x])[:, None]
    return interpolate(maps, size, mode="bilinear", antialias=True)[:, 0].clamp(0, 1)


def load_network(path: Path = WEIGHTS) -> U2Net:
    """The network with the weights of a file, kept until the file changes.

    Raises InputError for a file that is missing, damaged or of another network.
    """
    try:
        return _load(path, path.stat().st_mtime_ns)
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights that find the subject ({reason}): install gsedit "
            "again, or name the part with --at, --phrase or --region"
        ) from error


@lru_cache(maxsize=1)
def _load(path: Path, modified_ns: int) -> U2Net:
    from safetensors.torch import load_file

    with torch.random.fork_rng():  # initial weights would take numbers from the global generator
        network = U2Net()
    network.load_state_dict(load_file(path))
    return network.eval().requires_grad_(False)
