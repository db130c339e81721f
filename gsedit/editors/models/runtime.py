"""The seam between a model and who computes its networks."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from gsedit.errors import UsageError

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


def make_runtime(name: str) -> Runtime:
    """The runtime of that name; auto is torch where openvino is not installed.

    Raises UsageError for another name, and for openvino where it is not installed.
    """
    installed = find_spec("openvino") is not None
    match name:
        case "torch":
            return in_torch
        case "openvino" if not installed:
            raise UsageError("--runtime openvino needs openvino: pip install 'gsedit[openvino]'")
        case "openvino" | "auto":
            if not installed:
                return in_torch
            from gsedit.editors.models.openvino import Faster, OpenVino

            return OpenVino() if name == "openvino" else Faster(OpenVino())
    raise UsageError(f"--runtime must be torch, openvino or auto, not {name!r}")
