"""How much memory is free; and networks in bfloat16, where the processor has it and the error is
small."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.diffusion.guidance import Around, Branches, Need, Predictor
from gsedit.paper.diffusion.settings import Precision

GB = 1e9
SHARE = 0.5
"""Share of the free memory that is used where no budget is given: the scene and the caller need
some."""


def free_bytes() -> int:
    """Memory that new work can have: the system's, or less where a container has a limit."""
    return min(_system_bytes(), _container_bytes())


def _system_bytes() -> int:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        available = next(line for line in lines if line.startswith("MemAvailable:"))
        return int(available.split()[1]) * 1024
    except (OSError, StopIteration, ValueError):
        pass
    try:  # where the free memory is not reported: the whole memory
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return int(4 * GB)


def _container_bytes(folder: Path = Path("/sys/fs/cgroup")) -> int:
    """Bytes that are left below the limit of a container (cgroup v2)."""
    try:
        limit, used = ((folder / name).read_text() for name in ("memory.max", "memory.current"))
        return max(int(limit) - int(used), 0)
    except (OSError, ValueError):  # no such limit, or "max"
        return 1 << 62  # unlimited


def most_bytes() -> int:
    """The most memory that this process has had so far; 0 where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration, ValueError):
        return 0


MAX_ERROR = 0.02
"""Relative RMS error of a guided prediction up to which bfloat16 is taken. Its rounding alone
is 0.2 %, and guidance of 7.5 / 1.5 magnifies that by about its scale."""


def has_bfloat16() -> bool:
    """Whether the processor multiplies matrices in bfloat16 (AVX-512 BF16, AMX or Arm's)."""
    try:
        words = Path("/proc/cpuinfo").read_text().split()
    except OSError:
        return False
    return bool({"avx512_bf16", "amx_bf16", "bf16"}.intersection(words))


class InBfloat16(Around):
    """A Predictor whose convolutions and matrix products are in bfloat16; its weights keep their
    dtype."""

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """As the network's, under autocast."""
        with torch.autocast(x.device.type, dtype=torch.bfloat16):
            return self.network.branches(x, t, condition, need)


def with_precision(
    network: Predictor,
    guided: Callable[[Predictor], Float[Tensor, "v c y x"]],
    precision: Precision,
    supported: bool | None = None,
) -> Predictor:
    """The network in that precision; `guided` gives a guided prediction, to compare the two.

    auto takes bfloat16 where the processor has it (`supported`; None: look) and the error is at
    most MAX_ERROR.
    """
    if precision == "float32":
        return network
    rounded = InBfloat16(network)
    if precision == "bfloat16":
        return rounded
    if not (has_bfloat16() if supported is None else supported):
        return network
    error = relative_error(guided(rounded), guided(network))
    return rounded if error <= MAX_ERROR else network


def relative_error(x: Float[Tensor, "*d"], expected: Float[Tensor, "*d"]) -> float:
    """RMS of the difference over the RMS of what is expected."""
    return float((x.double() - expected.double()).norm() / expected.double().norm())
