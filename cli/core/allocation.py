"""How the memory allocator keeps what is freed."""

from __future__ import annotations

import ctypes
import sys

# of glibc's malloc.h
TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3
KEPT_BYTES = 2**31 - 1
"""Freed memory at the end of the heap that is kept for the next tensors; an int of C."""
STEP_BYTES = 2**26
"""The heap grows by so much at a time."""
LARGE_BYTES = 2**25
"""Tensors above it get pages of their own, which go back as they are freed: glibc's largest."""


def keep_freed_memory() -> None:
    """Let freed tensors of a few megabytes serve the next ones, where the allocator is glibc's.

    Else every one is given back to the system and asked for again, page by page.
    """
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    if mallopt is None:
        return
    for option, value in (
        (TRIM_THRESHOLD, KEPT_BYTES),
        (TOP_PAD, STEP_BYTES),
        (MMAP_THRESHOLD, LARGE_BYTES),
    ):
        mallopt(option, value)
