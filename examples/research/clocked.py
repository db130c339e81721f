"""Programs run to their end, each in a process of its own: seconds, CPU seconds, memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from gsedit.errors import GseditError


class Ran(NamedTuple):
    """A program that has ended, with the programs that it started and waited for."""

    text: str
    """All that was printed."""
    seconds: float
    cpu: float
    """Processor seconds of all threads."""
    gigabytes: float
    """Largest resident memory of one process, 1e9 bytes."""
    code: int

    @property
    def spent(self) -> tuple[float, float]:
        """Seconds and CPU seconds."""
        return self.seconds, self.cpu


def clocked(
    *words: object, environment: Mapping[str, str] | None = None, folder: Path | None = None
) -> Ran:
    """Run a program; `folder`: where it runs. It may fail: see `Ran.code`."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [*map(str, words)], stdout=said, stderr=said, env=environment, cwd=folder
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace")
    unit = 1 if sys.platform == "darwin" else 1024
    cpu = usage.ru_utime + usage.ru_stime
    return Ran(text, seconds, cpu, usage.ru_maxrss * unit / 1e9, process.returncode)


def must(ran: Ran, what: object) -> Ran:
    """The program that has run. Raises GseditError with its last line where it failed."""
    if ran.code:
        last = " ".join(ran.text.strip().splitlines()[-1:])
        raise GseditError(f"{what}: code {ran.code}, {last}")
    return ran


def gsedit(*words: object) -> Ran:
    """Run a command of gsedit. Raises GseditError where it fails."""
    return must(clocked(sys.executable, "-m", "gsedit_cli", *words), f"gsedit {words[0]}")
