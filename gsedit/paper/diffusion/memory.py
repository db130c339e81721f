"""How much memory is free, and how much this process has had."""

from __future__ import annotations

import os
from pathlib import Path

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
