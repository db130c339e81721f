"""Runtimes by their names."""

from __future__ import annotations

from importlib.util import find_spec

from gsedit.errors import UsageError
from gsedit.models.openvino import Faster, OpenVino
from gsedit.models.runtime import Runtime, in_torch


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
            return OpenVino() if name == "openvino" else Faster(OpenVino())
    raise UsageError(f"--runtime must be torch, openvino or auto, not {name!r}")
