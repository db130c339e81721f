"""Diagnosis of this machine: which parts gsedit needs, which are there, how to get the rest."""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from gsedit.run.environment import installed_version

IMPORT_TIMEOUT = 60
"""Seconds for importing a package in another process: the first read from a slow disk is slow."""


@dataclass(frozen=True)
class Check:
    """One thing that gsedit needs, or can use, on this machine."""

    name: str
    state: str
    """Its version, or what was measured, as text for a person."""
    advice: str = ""
    """Advice on a problem; empty where there is none."""


@dataclass(frozen=True)
class Library:
    """A package that is loaded where it is needed."""

    module: str
    used_by: str
    install: str
    """Name by which pip installs it."""
    distributions: tuple[str, ...] = ()
    """Names on PyPI that provide it; the module's if empty."""
    system: str = ""
    """Debian packages that it loads libraries of."""

    @property
    def version(self) -> str | None:
        """The installed version, without importing it."""
        names = self.distributions or (self.module,)
        return next((found for name in names if (found := installed_version(name))), None)


LIBRARIES = (
    Library("pycolmap", "reading COLMAP's folders and undistorting photos", "pycolmap"),
    Library("trimesh", "meshes and to_trimesh", "trimesh"),
    Library("matplotlib", "depth in color and colors of points", "'gsedit[plots]'"),
    Library("mcp", "gsedit mcp", "'gsedit[mcp]'"),
    Library("OpenEXR", "gsedit render -o picture.exr", "'gsedit[exr]'"),
    Library("av", "gsedit capture VIDEO, and render -o video.mp4", "'gsedit[video]'"),
    Library("pi_heif", "HEIC photos of iPhones in gsedit capture", "pi-heif", ("pi-heif",)),
    Library("viser", "gsedit app and view", "viser"),
    Library("pxr", ".usda, .usdc, .usd and .usdz", "'gsedit[usd]' (Python >= 3.11)", ("usd-core",)),
    Library(
        "pyvista", "gsedit view -o a.png", "'gsedit[points]'", system="libegl1 libgl1 libx11-6"
    ),
    Library(
        "open3d", "selections by a mesh, align --to and view --open3d", "'gsedit[mesh]'",
        ("open3d-cpu", "open3d"),
        "libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0",
    ),
)  # fmt: skip
UNTRIED = {
    **dict.fromkeys(
        ("diffusers", "transformers", "accelerate"),
        "the editors pix2pix and diffusers need it: pip install 'gsedit[diffusers]'",
    ),
    "openvino": "2D models run faster with it: pip install 'gsedit[openvino]'",
    "stlpips_pytorch": "perceptual distances need its weights: pip install 'gsedit[perceptual]'",
}
"""Packages that are not loaded for a check, as that takes long, and what to do without them."""
CORE = ("numpy", "scipy", "kornia", "pillow", "jaxtyping", "safetensors", "zstandard")
"""Packages that gsedit does not work without."""


def check_machine() -> Iterator[Check]:
    """All checks but those of weights. Raises nothing.

    What loads libraries of the system is tried in processes of its own, meanwhile.
    """
    # two at a time: each fills a processor
    with ThreadPoolExecutor(2) as pool:
        imports = {each: pool.submit(_load_failure, each) for each in reversed(LIBRARIES)}
        yield Check(
            "gsedit", installed_version("gsedit") or "not installed (run from its source folder)"
        )
        yield Check("python", f"{platform.python_version()} on {platform.platform()}")
        yield from check_packages()
        yield check_compiler()
        yield from check_libraries(imports)


def check_packages() -> Iterator[Check]:
    """torch, and the packages and weights that gsedit needs and that editors need."""
    yield check_torch()
    versions = {name: installed_version(name) for name in CORE}
    missing = " ".join(name for name, version in versions.items() if version is None)
    yield Check(
        "packages",
        ", ".join(f"{name} {version or 'MISSING'}" for name, version in versions.items()),
        f"gsedit needs them: pip install {missing}" if missing else "",
    )
    for name, move in UNTRIED.items():
        installed = installed_version(name)
        yield Check(name, installed or "not installed", "" if installed else move)
    from gsedit.paper.editors.registry import DEFAULT, EDITORS

    _, missing_of = EDITORS.ours[DEFAULT]
    yield Check("default editor", DEFAULT, "; ".join(missing_of()))


def check_torch() -> Check:
    """Its build: what it computes with, and whether it brings a GPU's libraries for nothing."""
    import torch

    from gsedit.paper.diffusion.precision import has_bfloat16

    speed = torch.backends.cpu.get_cpu_capability()
    short = ", bfloat16 in hardware" if has_bfloat16() else ""
    state = f"{torch.__version__} ({speed}{short})"
    if torch.version.cuda is None:
        return Check("torch", state)
    number = torch.__version__.split("+")[0]
    return Check(
        "torch",
        f"{state}, built for CUDA {torch.version.cuda}, which gsedit does not use",
        f"a CPU build of the same version saves gigabytes: pip install torch=={number} "
        "--index-url https://download.pytorch.org/whl/cpu",
    )


def check_compiler() -> Check:
    """Whether the C++ files of all packages compile here; compiles them the first time."""
    import gsedit
    import rasterizer
    from rasterizer import compiled

    folders = (Path(package.__path__[0]) for package in (rasterizer, gsedit))
    sources = (source for folder in folders for source in sorted(folder.rglob("*.cpp")))
    made = [compiled.make(source) for source in sources]
    failures = [f"{each.failure}: {each.move}" for each in made if each.failure]
    if not failures:
        note = next((each.note for each in made if each.note), "")
        return Check("compiled kernel", f"ready ({made[0].compiler})", note)
    found = "none: torch renders, slower"
    if len(failures) < len(made):
        found = (
            f"{len(failures)} of {len(made)} files do not compile: torch does their part, slower"
        )
    return Check("compiled kernel", found, failures[0])


def check_libraries(failures: dict[Library, Future[str]]) -> Iterator[Check]:
    """The packages that are loaded where they are needed, as they load in another process."""
    for library in LIBRARIES:
        version, needs = library.version, f"only {library.used_by} needs it"
        if version is None:
            yield Check(library.module, "not installed", f"{needs}: pip install {library.install}")
        elif failure := failures[library].result():
            system = f"; on Debian: apt-get install -y {library.system}" if library.system else ""
            name = (library.distributions or (library.module,))[0]
            again = "" if system else f": pip install --force-reinstall {name}"
            yield Check(library.module, f"{version}, but {failure}", f"{needs}{again}{system}")
        else:
            yield Check(library.module, version)


def _load_failure(library: Library) -> str:
    """Why an installed package does not load; empty where it does, or is not installed."""
    return _import_failure(f"import {library.module}") if library.version else ""


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
