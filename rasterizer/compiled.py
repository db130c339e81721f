"""C++ files without dependencies: a wheel brings their libraries, otherwise they are compiled once
per machine and kept.

A wheel has one for each level of vectors, beside the C++ file; the processor decides which is
opened. Elsewhere any C++17 compiler makes one in seconds. It is cached by the source, the compiler
and the processor, under $XDG_CACHE_HOME/gsedit or ~/.cache/gsedit, where only the user can write.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import hashlib
import os
import platform
import shutil
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

from rasterizer.compiler import (
    INSTALL,
    Compiler,
    CompilerError,
    compilation_key,
    compile_library,
    find_compiler,
)
from rasterizer.numerics import Kernel

Library = TypeVar("Library")

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
OTHERS_ENTER = stat.S_IRWXG | stat.S_IRWXO


def cache_folder() -> Path:
    """Return `$XDG_CACHE_HOME/gsedit` or `~/.cache/gsedit`, made if it was not there.

    A relative XDG_CACHE_HOME is ignored, as the XDG Base Directory Specification says. Raises
    OSError where there is no home folder, or others can change the folder.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():
        home = os.environ.get("HOME", "~")
        base = Path(os.path.expanduser(home)) / ".cache"
        if not home or not base.is_absolute():
            raise OSError(0, "HOME names no folder", home)
    folder = base / "gsedit"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = folder.resolve()  # a link is not followed again
    _check_private(folder)
    return folder


def find_library(
    folder: Path, name: str, open_library: Callable[[Path], Library]
) -> Library | None:
    """Open the library `name` of the cache; None where there is none that loads.

    It may come from another machine with the user's files. One that is cut off would end the
    process: its digest, the end of its name, shows that.
    """
    for path in kept_files(folder, name):
        try:
            _check_owner(path, path.lstat())
            if stat.S_ISREG(path.lstat().st_mode) and path.stem.endswith(digest(path.read_bytes())):
                return open_library(path)
        except (OSError, AttributeError):
            continue
    return None


def keep_library(
    folder: Path, name: str, made: Path, open_library: Callable[[Path], Library]
) -> Library:
    """Copy a library into the cache, instead of older ones of that name, and open it.

    Raises OSError where it cannot be written or opened there.
    """
    with tempfile.TemporaryDirectory(dir=folder) as private:  # so that it appears whole
        copy = Path(shutil.copyfile(made, Path(private) / made.name))
        copy.chmod(0o700)
        library = open_library(copy)  # first: another process may remove it from its place
        kept = copy.replace(folder / f"{name}-{digest(copy.read_bytes())}.so")
    for useless in set(kept_files(folder, name)) - {kept}:
        useless.unlink(missing_ok=True)
    return library


def kept_files(folder: Path, name: str) -> list[Path]:
    """List the files of a library in the cache, whatever they hold."""
    return sorted(folder.glob(f"{name}-*.so"))


def digest(content: bytes) -> str:
    """Digest what a library's name in the cache tells: its source, and its own bytes."""
    return hashlib.sha256(content).hexdigest()[:16]


def _check_private(folder: Path) -> None:
    """Raise OSError where other users can change what is in a folder.

    Its parents count too, down from the root: who can rename one can put another in its place.
    Below a folder that only the user can enter, nothing can be reached by others.
    """
    if not hasattr(os, "geteuid"):  # Windows: profiles are private
        return
    if folder.stat().st_uid == os.geteuid():
        folder.chmod(0o700)
    _check_owner(folder, folder.stat())
    for each in [*reversed(folder.parents)][1:]:  # whoever has the root has everything
        status = each.stat()
        if status.st_uid == os.geteuid() and not status.st_mode & OTHERS_ENTER:
            return
        _check_owner(each, status)


def _check_owner(path: Path, status: os.stat_result) -> None:
    """Raise OSError where a file is not the user's or root's, or others can write it.

    Others may write a sticky folder, as /tmp is: there they can change only what is theirs.
    """
    if not hasattr(os, "geteuid"):
        return
    if status.st_uid not in (os.geteuid(), 0):
        raise OSError(0, "it belongs to another user", str(path))
    if status.st_mode & OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
        raise OSError(0, "other users can write it", str(path))


class Level(NamedTuple):
    """Instructions that a library may use."""

    name: str
    """Ending of the library's name, as in `kernel-avx2.so`."""
    flags: tuple[str, ...]
    """Words that the compiler gets."""
    capabilities: tuple[str, ...]
    """Names that torch gives to processors which have them."""


# The flags are just the instructions that torch looks for before it names a processor so.
WIDEST = Level(
    "avx512",
    ("-mavx512f", "-mavx512bw", "-mavx512dq", "-mavx512vl", "-mfma", "-mprefer-vector-width=512"),
    ("AVX512",),
)
WIDE = Level("avx2", ("-mavx2", "-mfma"), ("AVX512", "AVX2"))
PLAIN = Level("plain", ("-Wno-psabi",), ())
"""SSE2 on x86-64, NEON on arm64: what every such processor has. The file's functions do not leave
it, so that passing wide vectors in another way is no warning."""


def levels(machine: str = "") -> tuple[Level, ...]:
    """List the levels of a kind of processor, the fastest first.

    `machine`: as `platform.machine()` names it; this one if empty.
    """
    x86 = (machine or platform.machine()).lower() in ("x86_64", "amd64")
    return (WIDEST, WIDE, PLAIN) if x86 else (PLAIN,)


def usable_levels() -> tuple[Level, ...]:
    """List the levels that this processor can run, the fastest first.

    torch tells what it has; ATEN_CPU_CAPABILITY=avx2 or default, which torch reads too, keeps wider
    vectors out of both.
    """
    import torch

    capability = torch.backends.cpu.get_cpu_capability()
    return tuple(each for each in levels() if each is PLAIN or capability in each.capabilities)


def shipped_library(source: Path) -> tuple[Path, Level] | None:
    """Find the best library beside a C++ file that this processor can run; None without one."""
    if not library_path(source, PLAIN).exists():  # as in every source tree
        return None
    found = ((library_path(source, level), level) for level in usable_levels())
    return next(((path, level) for path, level in found if path.exists()), None)


def library_path(source: Path, level: Level, folder: Path | None = None) -> Path:
    """Name the library of a C++ file, beside it or in another folder."""
    return (folder or source.parent) / f"{source.stem}-{level.name}.so"


def compile_levels(
    compiler: Compiler, source: Path, folder: Path, options: tuple[str, ...] = ()
) -> list[Path]:
    """Compile a C++ file for every level into a folder; `options` go to each call.

    Raises CompilerError, OSError.
    """
    made = []
    for level in levels():
        path = library_path(source, level, folder)
        compile_library(compiler, source, path, tunings=((*level.flags, *options),))
        made.append(path)
    return made


MAY_RUN = "set TMPDIR to a folder that can be written and where programs may run"


class Made(NamedTuple):
    """The library of a C++ file, or the reason why there is none."""

    library: ctypes.CDLL | None
    compiler: str
    """Its name, as in `g++`, or which of the wheel's libraries it is; empty where there is none."""
    failure: str = ""
    """Why there is no library."""
    note: str = ""
    """Why it could not be kept, and the next move."""
    move: str = INSTALL
    """The next move where there is no library."""


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
            f"kernel 'compiled': {made.failure}; {made.move}, or choose 'auto' or 'torch'"
        )
    return made.library


def function(library: ctypes.CDLL, name: str, dtype: object) -> Callable[..., int]:
    """The library's `name` for a torch dtype, as `name_float32`."""
    return getattr(library, f"{name}_{str(dtype).removeprefix('torch.')}")


@functools.cache
def make(source: Path) -> Made:
    """The library of a C++ file, of the wheel, from the cache or compiled; tried once in a process.

    One of the wheel that does not load is passed over.
    """
    name = ""
    with contextlib.suppress(OSError):
        if (found := shipped_library(source)) is not None:
            path, level = found
            return Made(_opened(path), f"of the wheel, {level.name}")
    try:
        compiler = find_compiler()
        name = compiler.name
        library, note = _cached_or_compiled(compiler, source)
    except CompilerError as error:
        return Made(None, name, str(error), move=error.move)
    except OSError as error:
        return Made(None, name, str(error), move=MAY_RUN)
    return Made(library, name, note=note)


def takes_seconds(source: Path) -> bool:
    """Whether `make` will compile: the wheel has no library, there is a compiler, and nothing in
    the cache that loads."""
    if shipped_library(source) is not None:
        return False
    try:
        key = _name(find_compiler(), source)
        return find_library(cache_folder(), key, _opened) is None
    except CompilerError:
        return False
    except OSError:
        return True


def _cached_or_compiled(compiler: Compiler, source: Path) -> tuple[ctypes.CDLL, str]:
    """The library, and why it could not be kept: empty where it is.

    Raises CompilerError; OSError where there is no folder to compile in, or nothing there runs.
    """
    name, folder, refusal = _name(compiler, source), None, None
    try:
        folder = cache_folder()
        if (found := find_library(folder, name, _opened)) is not None:
            return found, ""
    except OSError as error:
        refusal = error
    with tempfile.TemporaryDirectory() as private:
        made = Path(private) / "kernel.so"
        compile_library(compiler, source, made)
        try:
            if folder is not None:
                return keep_library(folder, name, made, _opened), ""
        except OSError as error:
            refusal = error
        return _opened(made), _not_kept(refusal)


def _name(compiler: Compiler, source: Path) -> str:
    return f"{source.stem}-{digest(compilation_key(compiler, source).encode())}"


def _not_kept(error: OSError | None) -> str:
    """Say why a library is not in the cache, and what helps."""
    where, code = "that can be written", error and error.errno
    if code in (errno.ENOSPC, errno.EDQUOT):
        where = "that has room"
    elif code == 0:
        where = "that only you can write"
    elif code is None:  # it was written, but did not load
        where = "where programs may run"
    why = f"{error.filename}: {error.strerror}" if error and error.strerror else str(error)
    return (
        f"the compiled kernel cannot be kept ({why}), and is compiled each time: set "
        f"XDG_CACHE_HOME to a folder {where}"
    )


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
