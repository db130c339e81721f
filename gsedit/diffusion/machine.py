"""What of this machine the sampler may use: how many views fit in memory at once, and bfloat16."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.predictor import Predictor
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import Precision

GB = 1e9
SHARE = 0.5
"""Of the free memory, where no budget was given: the scene and the caller live there, too."""
BOUND = 0.02
"""Relative RMS error of a guided prediction up to which bfloat16 is taken. Its rounding alone
is 0.2 %, and guidance of 7.5 / 1.5 magnifies that by about its scale."""


def free_bytes() -> int:
    """Memory that new work can have: the system's, or less where a container has a limit."""
    return min(_available(), _below_limit())


def _available() -> int:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        told = next(line for line in lines if line.startswith("MemAvailable:"))
        return int(told.split()[1]) * 1024
    except (OSError, StopIteration, ValueError):
        pass
    try:  # no word of what is free: all there is
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return int(4 * GB)


def _below_limit(folder: Path = Path("/sys/fs/cgroup")) -> int:
    try:
        limit, used = ((folder / name).read_text() for name in ("memory.max", "memory.current"))
        return max(int(limit) - int(used), 0)
    except (OSError, ValueError):  # no such limit, or "max"
        return 1 << 62


def views_at_once(views: int, view_bytes: int, budget: float | None) -> int:
    """How many views fit under `budget` GB (None: half of what is free), at least one."""
    room = SHARE * free_bytes() if budget is None else budget * GB
    return min(max(int(room // max(view_bytes, 1)), 1), views)


def peak_bytes(work: Callable[[], Any]) -> int:
    """The most memory that tensors made by `work` hold at one time. Inputs are not counted."""
    with _Ledger() as ledger:
        work()
    return ledger.peak


class _Ledger(TorchDispatchMode):
    """Counts the storages that operations make, until they are gone."""

    def __init__(self) -> None:
        super().__init__()
        self.held = self.peak = 0
        self.known: set[int] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        inputs = {_key(x) for x in tree_leaves((args, kwargs)) if isinstance(x, Tensor)}
        result = func(*args, **(kwargs or {}))
        for made in tree_leaves(result):
            if isinstance(made, Tensor) and _key(made) not in inputs | self.known:
                self._enter(made)
        return result

    def _enter(self, made: Tensor) -> None:
        storage = made.untyped_storage()
        size, key = storage.nbytes(), _key(made)
        self.known.add(key)
        self.held += size
        self.peak = max(self.peak, self.held)
        weakref.finalize(storage, self._leave, key, size)

    def _leave(self, key: int, size: int) -> None:
        self.known.discard(key)
        self.held -= size


def _key(x: Tensor) -> int:
    return x.untyped_storage()._cdata


def has_bfloat16() -> bool:
    """Whether the processor multiplies matrices in bfloat16 (AVX-512 BF16, AMX or Arm's)."""
    try:
        words = Path("/proc/cpuinfo").read_text().split()
    except OSError:
        return False
    return bool({"avx512_bf16", "amx_bf16", "bf16"}.intersection(words))


@dataclass(frozen=True, eq=False)
class InBfloat16:
    """The same network, its convolutions and products in bfloat16, its weights as they are."""

    network: Predictor

    @property
    def name(self) -> str:
        return self.network.name

    @property
    def schedule(self) -> Schedule:
        return self.network.schedule

    @property
    def predicts(self) -> Prediction:
        return self.network.predicts

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        with torch.autocast(x.device.type, dtype=torch.bfloat16):
            return self.network.branches(x, t, condition, need)


def faster(
    network: Predictor,
    ask: Callable[[Predictor], Tensor],
    precision: Precision,
    able: bool | None = None,
) -> Predictor:
    """The network as `precision` wants it. `ask` gives a guided prediction, to be compared.

    auto takes bfloat16 where the processor is `able` (None: look) and the error is below BOUND.
    """
    if precision == "float32":
        return network
    rounded = InBfloat16(network)
    if precision == "bfloat16":
        return rounded
    if not (has_bfloat16() if able is None else able):
        return network
    return rounded if relative_error(ask(rounded), ask(network)) <= BOUND else network


def relative_error(found: Tensor, expected: Tensor) -> float:
    """RMS of the difference over the RMS of what is expected."""
    return float((found.double() - expected.double()).norm() / expected.double().norm())
