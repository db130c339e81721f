"""What this machine has that an edit needs, and what to do about what it lacks."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from gsedit.errors import GseditError

LITTLE_MEMORY = 4e9
"""Bytes. Below, an edit at the default size still runs, a fit or a large model may not."""
PATIENCE = 120  # seconds for importing a package in another process: cold disks are slow


@dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str
    found: str
    advice: str = ""
    """The next move where something is missing; empty where all is well."""


def check_machine() -> Iterator[Check]:
    """Everything but weights, quickest first; nothing is raised."""
    yield Check("gsedit", _version("gsedit") or "not installed (run from its source folder)")
    yield Check("python", f"{platform.python_version()} on {platform.platform()}")
    yield from check_packages()
    yield check_threads()
    yield check_memory()
    yield check_compiler()
    yield from check_viewers()


def check_packages() -> Iterator[Check]:
    """What computes, and what the editors need besides."""
    import torch

    from gsedit.diffusion.machine import has_bfloat16
    from gsedit.editors.registry import BUILT_IN, DEFAULT

    cuda = f", built for CUDA {torch.version.cuda}: not used" if torch.version.cuda else ""
    speed = torch.backends.cpu.get_cpu_capability()
    short = ", bfloat16 in hardware" if has_bfloat16() else ""
    yield Check("torch", f"{torch.__version__} ({speed}{short}{cuda})")
    for name in ("diffusers", "transformers"):
        found = _version(name)
        advice = "" if found else "the pix2pix editor needs it: pip install 'gsedit[diffusers]'"
        yield Check(name, found or "not installed", advice)
    _, missing = BUILT_IN[DEFAULT]
    yield Check("default editor", DEFAULT, "; ".join(missing()))


def check_threads() -> Check:
    """How many threads torch takes of the processors that this process may use."""
    import torch

    may = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads = torch.get_num_threads()
    advice = ""
    if threads > may:
        advice = f"more threads than processors stall each other: add --threads {may}"
    elif threads < may and "OMP_NUM_THREADS" in os.environ:
        advice = f"OMP_NUM_THREADS={os.environ['OMP_NUM_THREADS']} leaves processors idle"
    return Check("threads", f"{threads} of {may} processors", advice)


def check_memory() -> Check:
    """What new work may have: the system's, or a container's own limit."""
    from gsedit.diffusion.machine import free_bytes

    free = free_bytes()
    advice = "close other programs, or use a smaller --size" if free < LITTLE_MEMORY else ""
    return Check("memory", f"{free / 1e9:.1f} GB free", advice)


def check_compiler() -> Check:
    """Whether the rasteriser's kernel compiles here; compiles it if it never was."""
    from rasterizer.blending import cpp_backend as compiled

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        kernel = compiled.load()
    if kernel is not None:
        return Check("compiled kernel", "ready")
    reason = str(told[-1].message) if told else "see the warning above"
    return Check("compiled kernel", "none: everything works, slower", reason)


def check_viewers() -> Iterator[Check]:
    """The two packages that need system libraries; neither is needed to edit or to render."""
    failed = _fails("import open3d")
    yield Check(
        "open3d",
        failed or f"{_version('open3d-cpu') or _version('open3d') or 'unknown version'}",
        ""
        if not failed
        else "only to_open3d needs it; on Debian: apt-get install -y "
        "libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0",
    )
    yield _tried("pyvista", _draw, _version("pyvista") or "unknown version")


def _draw() -> None:
    """A point drawn off screen, as `gsedit preview` does."""
    import torch

    from gsedit.viewer.preview import snapshot
    from gsedit.views.framing import framing_camera
    from rasterizer.scene import Gaussians

    unit = torch.eye(3)
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(3, 1)
    scene = Gaussians(unit, quats, -4 * torch.ones(3, 3), torch.ones(3), torch.zeros(3, 1, 3))
    snapshot(scene, framing_camera(scene, size=(16, 16)))


def _tried(name: str, work: Callable[[], None], found: str) -> Check:
    try:
        work()
    except GseditError as error:
        return Check(name, "does not draw", f"only gsedit preview needs it; {error}")
    return Check(name, f"{found}, draws")


def _fails(code: str) -> str:
    """Why a line of Python fails in another process (a library can end the process it is in)."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True, text=True, timeout=PATIENCE, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no answer within {PATIENCE} s"
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]


def _version(package: str) -> str:
    """The installed version; empty where there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
