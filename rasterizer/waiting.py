"""How OpenMP's threads wait for each other: they spin briefly, then sleep.

A thread that spins keeps a processor from the thread that it waits for, where another program has
taken that one's. libgomp, the OpenMP library of torch on Linux, spins for 300,000 pauses by itself,
8 to 15 ms: longer than a scheduler's time slice, and two programs of two threads on two processors
hardly move. Sleeping at once costs time too: torch renders in hundreds of parallel regions.
"""

from __future__ import annotations

import os
import sys
from functools import cache

SPINS = 1000
"""Pauses before a thread sleeps: 25 to 50 microseconds. On two processors with nine programs, a
step of a fit takes 188 ms of CPU time by torch and 23 by the kernel; with 4,000 pauses 389 and 34,
without any 119 and 21."""
POLICIES = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Variables that libgomp reads once, when it is loaded."""


@cache
def wait_briefly() -> str:
    """Let OpenMP's threads sleep soon, unless the user has decided or torch is loaded already.

    Decided once in a process, when the package is imported. Results do not change. Returns the
    setting that holds, as in GOMP_SPINCOUNT=1000; empty where torch was loaded before.
    """
    given = [f"{name}={os.environ[name]}" for name in POLICIES if name in os.environ]
    if not given and "torch" not in sys.modules:
        os.environ["GOMP_SPINCOUNT"] = str(SPINS)
        given = [f"GOMP_SPINCOUNT={SPINS}"]
    return " ".join(given)
