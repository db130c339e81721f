"""A picture of 3D Gaussians and its gradient, on a CPU. Usable alone.

Each name is imported when it is first used: `import rasterizer.numerics` loads no torch.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from rasterizer.camera import Camera, look_at
    from rasterizer.numerics import Execution, Numerics
    from rasterizer.rasterization import rasterization
    from rasterizer.render import Rendering, contributions, render
    from rasterizer.scene import Gaussians, concatenate

# OpenMP's threads spin while they wait, and keep a processor from the thread that they wait for,
# where another program has taken that one's. libgomp, torch's on Linux, spins for 8 to 15 ms: more
# than a scheduler's time slice. Sleeping at once costs time too: torch renders in many regions.
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


wait_briefly()  # torch, which reads the variable when it is loaded, is imported later
make_lazy(__name__)
