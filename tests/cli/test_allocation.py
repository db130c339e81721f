"""Freed memory serves the next tensors."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

BUFFERS = """
from resource import RUSAGE_SELF, getrusage
from gsedit_cli.core.allocation import keep_freed_memory

def pages_asked_for():
    before = getrusage(RUSAGE_SELF).ru_minflt
    for _ in range(10):
        buffers = [b"x" * 6_000_000 for _ in range(4)]
        del buffers
    return getrusage(RUSAGE_SELF).ru_minflt - before

keep_freed_memory()
pages_asked_for()
print(pages_asked_for())
"""


@pytest.mark.skipif(
    not (sys.platform.startswith("linux") and hasattr(ctypes.CDLL(None), "mallopt")),
    reason="needs glibc, whose allocator this sets",
)
def test_buffers_as_large_as_freed_ones_ask_the_system_for_no_page():
    """Each round fills 24 MB: 5,900 pages of 4 kB if they were new."""
    child = [sys.executable, "-c", BUFFERS]
    done = subprocess.run(child, capture_output=True, text=True, check=True)
    assert int(done.stdout) < 1000
