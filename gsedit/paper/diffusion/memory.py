"""How much memory a computation takes, and how many views therefore fit in one pass."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

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


def views_at_once(views: int, view_bytes: int, budget: float | None) -> int:
    """How many views fit under `budget` GB (None: half of what is free), from 1 to `views`."""
    room = SHARE * free_bytes() if budget is None else budget * GB
    return min(max(int(room // max(view_bytes, 1)), 1), views)


def peak_bytes(work: Callable[[], Any]) -> int:
    """The most memory that tensors made by `work` hold at one time. Inputs are not counted."""
    with _StorageCounter() as counter:
        work()
    return counter.peak


class _StorageCounter(TorchDispatchMode):
    """Counts the bytes of the storages that operations make, until these are freed."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes = self.peak = 0
        self.alive: set[int] = set()

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        """False: what is counted is never compiled, and marking it so imports the compiler, which
        takes more than a second."""
        return False

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        inputs = {_key(x) for x in tree_leaves((args, kwargs)) if isinstance(x, Tensor)}
        result = func(*args, **(kwargs or {}))
        for output in tree_leaves(result):
            if isinstance(output, Tensor) and _key(output) not in inputs | self.alive:
                self._add(output)
        return result

    def _add(self, tensor: Tensor) -> None:
        storage = tensor.untyped_storage()
        size, key = storage.nbytes(), _key(tensor)
        self.alive.add(key)
        self.bytes += size
        self.peak = max(self.peak, self.bytes)
        weakref.finalize(storage, self._remove, key, size)

    def _remove(self, key: int, size: int) -> None:
        self.alive.discard(key)
        self.bytes -= size


def _key(x: Tensor) -> int:
    return x.untyped_storage()._cdata
