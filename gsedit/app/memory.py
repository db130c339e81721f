"""Memory that is free, given back to the system: the C library keeps it for a process otherwise.

A page draws in one thread, prepares in another and previews in a third: each would keep what its
largest work took, which at a million Gaussians is more than the scene.
"""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

ARENAS_OPTION, ARENAS = -8, 2
"""M_ARENA_MAX of mallopt(3), and how many heaps threads share."""


def share_heaps() -> None:
    """Let threads share heaps; to be called before they start. Nothing where the C library has no
    such option."""
    with suppress(OSError, AttributeError):
        if sys.platform == "linux":
            ctypes.CDLL(None).mallopt(ARENAS_OPTION, ARENAS)


def give_back() -> None:
    """Return what is free, as far as the C library can."""
    with suppress(OSError, AttributeError):
        if sys.platform == "linux":
            ctypes.CDLL(None).malloc_trim(0)
