"""Libraries that a wheel brings beside its C++ files: one for each level of vectors, compiled where
the wheel was built. The processor decides which is opened; no compiler is needed.

A source tree has none: its files are compiled on first use.
"""

from __future__ import annotations

import platform
from pathlib import Path
from typing import NamedTuple

from rasterizer.compiler import Compiler, compile_library


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
