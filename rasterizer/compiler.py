"""The C++ compiler of this machine: which one it is, what its results depend on, one call of it."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

FLAGS = ("-std=c++17", "-shared", "-fPIC", "-pthread", "-O3", "-fno-math-errno",
         "-fno-trapping-math", "-fopenmp-simd")  # fmt: skip
# No -ffast-math: linking with it would make the whole process flush denormals to zero.
FOR_THIS_PROCESSOR = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ())
"""Tried in this order: not every compiler knows every one."""
HEADERS = Path(__file__).parent
"""The folder of `threads.h`, which all sources may include."""
TIMEOUT_S = 120.0
"""Longest run of a compiler, seconds. A file takes 0.5 to 4 of them."""
WORK_BYTES = 20_000_000
"""Free space that compiling one file takes, with its intermediate files."""

INSTALL = "install g++ or clang++, or name a C++17 compiler in CXX"
OTHER_COMPILER = "name another C++17 compiler in CXX"
CORRECT_CXX = "name a C++17 compiler in CXX, or unset it"
MAKE_ROOM = "set TMPDIR to a folder that has room"


class CompilerError(Exception):
    """The reason why there is no library, and what helps."""

    def __init__(self, reason: str, move: str) -> None:
        super().__init__(reason)
        self.move = move


class Compiler(NamedTuple):
    """A compiler that can be started."""

    command: tuple[str, ...]
    """Words of its command line; the first is a path. `CXX="ccache g++"` makes two."""

    @property
    def name(self) -> str:
        """Short name for messages, as in `g++`."""
        return " ".join((Path(self.command[0]).name, *self.command[1:]))


def find_compiler() -> Compiler:
    """Find the compiler that CXX names, or the first of c++, g++ and clang++.

    CXX may have options; no shell reads it. Raises CompilerError where there is none.
    """
    if "CXX" not in os.environ:
        names = ("c++", "g++", "clang++")
        path = next((path for name in names if (path := shutil.which(name))), None)
        if path is None:
            raise CompilerError(f"no C++ compiler was found ({', '.join(names)})", INSTALL)
        return Compiler((path,))
    named = os.environ["CXX"]
    try:
        program, *options = shlex.split(named) or [""]
    except ValueError as error:
        raise CompilerError(f"CXX is no command line ({error})", CORRECT_CXX) from error
    path = shutil.which(program) if program else None
    if path is None:
        raise CompilerError(f"no C++ compiler was found (CXX is {named!r})", CORRECT_CXX)
    return Compiler((path, *options))


def compile_library(
    compiler: Compiler,
    source: Path,
    target: Path,
    *,
    tunings: Iterable[tuple[str, ...]] = FOR_THIS_PROCESSOR,
    timeout_s: float = TIMEOUT_S,
) -> None:
    """Compile a C++ file to a library, with the first of `tunings` that works.

    Raises CompilerError with the compiler's first line, OSError where it cannot be started.
    """
    complaint = ""
    for tuning in tunings:
        flags = (*FLAGS, *tuning, f"-I{HEADERS}")
        done = _run(compiler, *flags, str(source), "-o", str(target), timeout_s=timeout_s)
        if done.returncode == 0:
            return
        complaint = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
    full = shutil.disk_usage(target.parent).free < WORK_BYTES
    reason = f"{compiler.name} could not compile {source.name} ({complaint})"
    raise CompilerError(reason, MAKE_ROOM if full else OTHER_COMPILER)


def compilation_key(compiler: Compiler, source: Path) -> str:
    """Return everything that the library of a C++ file depends on.

    Raises CompilerError, and OSError where the compiler cannot be started.
    """
    headers = sorted({*source.parent.glob("*.h"), *HEADERS.glob("*.h")})
    return "\n".join(
        (
            *(file.read_text() for file in (source, *headers)),
            *compiler.command,
            _run(compiler, "--version").stdout,
            *FLAGS,
            str(FOR_THIS_PROCESSOR),
            _processor(),
        )
    )


def _run(
    compiler: Compiler, *arguments: str, timeout_s: float = TIMEOUT_S
) -> subprocess.CompletedProcess[str]:
    """Run the compiler to its end; its words may be in any encoding. Raises CompilerError where
    it does not end, OSError where it cannot be started."""
    command = (*compiler.command, *arguments)
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, errors="replace", start_new_session=True,
    ) as process:  # fmt: skip
        try:
            said, complained = process.communicate(timeout=timeout_s)
        except BaseException as error:
            _kill_session(process)
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            reason = f"{compiler.name} did not end within {timeout_s:g} s"
            raise CompilerError(reason, OTHER_COMPILER) from error
    return subprocess.CompletedProcess(command, process.returncode, said, complained)


def _kill_session(process: subprocess.Popen[str]) -> None:
    """Kill a process and its children, which hold its pipes open."""
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def _processor() -> str:
    """Describe what -march=native depends on."""
    fields = ("vendor_id", "cpu family", "model", "flags", "Features", "CPU", "cpu\t")
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    found = {line for line in lines if line.startswith(fields)}
    if platform.system() == "Darwin":
        query = ("sysctl", "-n", "machdep.cpu.brand_string")
        found.add(subprocess.run(query, capture_output=True, text=True, check=False).stdout)
    return "\n".join((*sorted(found), platform.platform(), platform.processor()))
