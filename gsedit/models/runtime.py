"""The seam between a model and who computes its networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

Forward = Callable[..., Tensor]
"""(network, tensors...) -> tensor: a module-level function, with no other inputs or state."""


@runtime_checkable
class Runtime(Protocol):
    """Computes a network's forward function, in torch or in another library.

    A runtime may trace `forward` once for each shape of the inputs, so it must not branch on their
    values. Where all inputs have the same leading dimension, its rows must not influence each
    other: a runtime may compute some at a time.
    """

    def __call__(self, forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
        """The result of `forward(network, *inputs)`."""
        ...


def in_torch(forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
    """The Runtime that calls the function."""
    return forward(network, *inputs)
