"""Weights of the painter's networks, from the files that come with gsedit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from torch import Tensor, nn

from gsedit.errors import InputError


@contextmanager
def weights_of(path: Path) -> Iterator[dict[str, Tensor]]:
    """Weights by name, float32: those of 8 bits in the file times the scales of their channels.

    InputError is raised where the file is missing or damaged, and for whatever is raised meanwhile.
    """
    from safetensors.torch import load_file

    try:
        held = load_file(path)
        for name in [each for each in held if each.endswith(".scale")]:
            weight = f"{name.removesuffix('.scale')}.weight"
            channels = held[weight].movedim(0, -1)
            held[weight] = (channels * held.pop(name)).movedim(-1, 0).contiguous()
        yield held
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the painter's weights ({reason}): install gsedit again"
        ) from error


def hold(network: nn.Module, weights: dict[str, Tensor]) -> None:
    """Give a network, made on the device "meta", its weights, of which none will learn."""
    network.load_state_dict(weights, assign=True)
    network.eval().requires_grad_(False)
