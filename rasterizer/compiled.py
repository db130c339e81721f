"""C++ files without dependencies, compiled once per machine and kept.

Any C++17 compiler makes one in seconds. The result is cached by the source, the compiler and the
processor, under $XDG_CACHE_HOME/gsedit or ~/.cache/gsedit.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from rasterizer.numerics import Kernel

FLAGS = ("-std=c++17", "-shared", "-fPIC", "-pthread", "-O3", "-fno-math-errno",
         "-fno-trapping-math", "-fopenmp-simd")  # fmt: skip
# No -ffast-math: linking with it would make the whole process flush denormals to zero.
FOR_THIS_PROCESSOR = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ())
"""Tried in this order: not every compiler knows every one."""
HEADERS = Path(__file__).parent
"""Where `threads.h` is, which all sources may include."""

MOVE = "install g++ or clang++, or name a C++17 compiler in CXX"
"""What helps where there is no library."""


class Made(NamedTuple):
    """What came of a C++ file."""

    library: ctypes.CDLL | None
    compiler: str
    """Its name, as in `g++`; empty where none was found."""
    failure: str = ""
    """Why there is no library."""
    note: str = ""
    """Why it could not be kept, and the next move."""


def load(source: Path, kernel: Kernel = "auto") -> ctypes.CDLL | None:
    """The library of a C++ file, compiled if it is not in the cache, where `Execution.kernel` is
    `kernel`: None for torch, and for auto where it cannot be made.

    Raises RuntimeError for compiled where it cannot be made.
    """
    if kernel == "torch":
        return None
    made = make(source)
    if made.library is None and kernel == "compiled":
        raise RuntimeError(
            f"kernel 'compiled': {made.failure}; {MOVE}, or choose 'auto' or 'torch'"
        )
    return made.library


def function(library: ctypes.CDLL, name: str, dtype: object) -> Callable[..., int]:
    """The library's `name` for a torch dtype, as `name_float32`."""
    return getattr(library, f"{name}_{str(dtype).removeprefix('torch.')}")


@functools.cache
def make(source: Path) -> Made:
    """The library of a C++ file, from the cache or compiled; tried once in a process."""
    names, compiler = _compiler()
    if compiler is None:
        return Made(None, "", f"no C++ compiler was found ({', '.join(map(str, names))})")
    name = Path(compiler).name
    try:
        try:
            return Made(_cached(compiler, source), name)
        except OSError as error:
            with tempfile.TemporaryDirectory() as folder:
                path = _compile(compiler, source, Path(folder) / "kernel.so")
                return Made(_opened(path), name, note=_not_kept(error))
    except (_Failed, OSError) as error:
        return Made(None, name, str(error))


def _opened(path: Path) -> ctypes.CDLL:
    """A library, which works on torch's threads where OpenMP runs them. Raises OSError."""
    library = ctypes.CDLL(str(path))
    library.use_team(_team())
    if hasattr(os, "register_at_fork"):  # OpenMP would wait for threads that a child does not have
        os.register_at_fork(after_in_child=lambda: library.use_team(None))
    return library


def _team() -> ctypes.c_void_p | None:
    """GOMP_parallel of the OpenMP library that torch has loaded for all; None where it has not."""
    try:
        return ctypes.cast(ctypes.CDLL(None).GOMP_parallel, ctypes.c_void_p)
    except (AttributeError, OSError, TypeError):  # other OpenMP libraries; Windows
        return None


def _not_kept(error: OSError) -> str:
    why = f"{error.filename}: {error.strerror}" if error.strerror else str(error)
    return (
        f"the compiled kernel cannot be kept ({why}), and is compiled each time: set "
        "XDG_CACHE_HOME to a folder that can be written"
    )


class _Failed(Exception):
    """Why there is no kernel."""


def takes_seconds(source: Path) -> bool:
    """Whether `make` will compile: there is a compiler, and nothing in the cache that loads."""
    _, compiler = _compiler()
    try:
        return compiler is not None and _kept(_place(compiler, source)) is None
    except OSError:
        return True


def _compiler() -> tuple[tuple[str, ...], str | None]:
    """Names of compilers, and the path of the first that there is."""
    names = (os.environ["CXX"],) if "CXX" in os.environ else ("c++", "g++", "clang++")
    return names, next((path for name in names if name and (path := shutil.which(name))), None)


def _cached(compiler: str, source: Path) -> ctypes.CDLL:
    """The library in the cache, compiled if it was not there or did not load. Raises OSError where
    the cache cannot be used, and _Failed."""
    place = _place(compiler, source)
    library = _kept(place)
    if library is None:
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:  # so that it appears whole
            made = _compile(compiler, source, Path(folder) / "kernel.so")
            library = _opened(made)  # first: another process may remove it from its place
            kept = made.replace(place.with_name(f"{place.name}-{_digest(made)}.so"))
        for useless in set(_copies(place)) - {kept}:
            useless.unlink(missing_ok=True)
    return library


def _kept(place: Path) -> ctypes.CDLL | None:
    """The library at a place of the cache; None where there is none that loads: it may come from
    another machine with the user's files. One that is cut off would end the process."""
    for path in _copies(place):
        with contextlib.suppress(OSError, AttributeError):
            if path.stem.endswith(_digest(path)):
                return _opened(path)
    return None


def _copies(place: Path) -> list[Path]:
    return sorted(place.parent.glob(f"{place.name}-*.so"))


def _digest(path: Path) -> str:
    """Of what a file holds: the end of its name in the cache."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _place(compiler: str, source: Path) -> Path:
    """The library's file in the cache, without the digest and suffix. Raises OSError."""
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:  # the user has no home folder
        raise OSError(*error.args) from error
    version = _ran(compiler, "--version")
    headers = sorted({*source.parent.glob("*.h"), *HEADERS.glob("*.h")})
    key = "\n".join(
        (
            *(file.read_text() for file in (source, *headers)),
            compiler,
            version.stdout,
            *FLAGS,
            str(FOR_THIS_PROCESSOR),
            _processor(),
        )
    )
    name = f"{source.stem}-{hashlib.sha256(key.encode()).hexdigest()[:16]}"
    return Path(base) / "gsedit" / name


def _ran(*command: str) -> subprocess.CompletedProcess[str]:
    """A command that has ended; what it wrote may be in any encoding. Raises OSError."""
    return subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)


def _processor() -> str:
    """What -march=native depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    model = {line for line in lines if line.startswith(("model name", "flags", "Features"))}
    return "\n".join((*sorted(model), platform.platform(), platform.processor()))


def _compile(compiler: str, source: Path, target: Path) -> Path:
    """`target`, made from the source. Raises _Failed with the compiler's first line."""
    complaint = ""
    for tuning in FOR_THIS_PROCESSOR:
        done = _ran(compiler, *FLAGS, *tuning, f"-I{HEADERS}", str(source), "-o", str(target))
        if done.returncode == 0:
            return target
        complaint = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
    raise _Failed(f"{compiler} could not compile {source.name} ({complaint})")
