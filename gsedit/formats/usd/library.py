"""usd-core, in a child process: it reads files of strangers in C++ and can crash on damaged ones.

The child's memory and the bytes that it writes are bounded by the size of the file.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from importlib.util import find_spec
from pathlib import Path

import gsedit
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.limits import ALWAYS_BYTES

EXPANSION = 128
"""Bytes of numbers for a byte of a file: lists of equal numbers are packed well."""
TEXT = 8
"""Bytes of text for a byte of numbers, at most: 17 for the 4 of a float, and brackets."""
MEMORY = 1 << 31
"""Bytes of address space that the child may take beside what its files explain: the library
itself maps 0.4 GB."""
SECONDS = 60
"""CPU seconds that the child may take, and as many for every 10 MB."""
INSTALL = "pip install 'gsedit[usd]' (Python 3.11 or newer)"


class Scratch:
    """A file in a folder of its own, removed with the last who holds it."""

    def __init__(self, name: str) -> None:
        folder = Path(tempfile.mkdtemp(prefix="gsedit-usd-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = folder / name

    def __fspath__(self) -> str:
        return str(self.path)

    __str__ = __fspath__


def values_of(path: Path) -> Scratch:
    """The numbers of a USD file's splats, with what they are in a .json beside them.

    Raises UsageError without usd-core, InputError for a file that it cannot read.
    """
    check_installed(path)
    scratch = Scratch("values")
    size = path.stat().st_size
    most = max(ALWAYS_BYTES, EXPANSION * size)
    reason = _run("read", path, scratch.path, size, most)
    if reason is not None and scratch.path.exists() and scratch.path.stat().st_size >= most:
        reason = f"it unpacks to more than {most >> 20} MB"
    if reason is not None:
        raise InputError(f"{path} cannot be read as USD ({reason}): export it again")
    return scratch


def write_folder(folder: Path, path: Path, size: int) -> None:
    """Write the rows in a folder, `size` bytes, by the suffix of `path`. Raises GseditError where
    the library fails."""
    reason = _run("write", folder, path, size, ALWAYS_BYTES + TEXT * size)
    if reason is not None:
        raise GseditError(f"{path} could not be written ({reason}): write another format")


def check_installed(path: Path) -> None:
    """Raise UsageError without usd-core."""
    if find_spec("pxr") is None:
        raise UsageError(f"{path}: USD needs usd-core: {INSTALL}")


def _run(task: str, source: Path, target: Path, size: int, written: int) -> str | None:
    """Run a task of `child.py`; what went wrong, as one line, or None."""
    limits = (MEMORY + 32 * size + written, written, SECONDS * (1 + size // 10**7))
    done = subprocess.run(
        [sys.executable, "-m", "gsedit.formats.usd.child", task, str(source.absolute()),
         str(target.absolute()), *map(str, limits)],
        stdin=subprocess.DEVNULL, capture_output=True, check=False,
        cwd=Path(gsedit.__file__).parents[1],  # not where a stranger's pxr.py may lie
        env={**os.environ, "PXR_WORK_THREAD_LIMIT": "1"},
    )  # fmt: skip
    if done.returncode == 0 and target.exists():
        return None
    told = done.stdout.decode("utf-8", "replace").strip().splitlines()
    return told[-1][:200] if told and done.returncode == 1 else "usd-core ended on it"
