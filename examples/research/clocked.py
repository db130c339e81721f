"""Programs run to their end, each in a process of its own: seconds, CPU seconds, memory."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from gsedit.errors import GseditError

WAITS = """
import json, os, subprocess, sys, time
began = time.monotonic()
process = subprocess.Popen(sys.argv[2:])
_, status, usage = os.wait4(process.pid, 0)
spent = time.monotonic() - began, usage.ru_utime + usage.ru_stime, usage.ru_maxrss
with open(sys.argv[1], "w") as file:
    json.dump((*spent, os.waitstatus_to_exitcode(status)), file)
"""
"""A small program that starts another: Linux counts the memory of a program's parent as its own."""


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
    with tempfile.TemporaryDirectory() as place:
        said, spent = Path(place, "said"), Path(place, "spent")
        with said.open("wb") as file:
            subprocess.run(
                [sys.executable, "-S", "-c", WAITS, str(spent), *map(str, words)],
                stdout=file, stderr=file, env=environment, cwd=folder, check=True,
            )  # fmt: skip
        seconds, cpu, peak, code = json.loads(spent.read_text())
        text = said.read_text(errors="replace")
    return Ran(text, seconds, cpu, peak * (1 if sys.platform == "darwin" else 1024) / 1e9, code)


def must(ran: Ran, what: object) -> Ran:
    """The program that has run. Raises GseditError with its last line where it failed."""
    if ran.code:
        last = " ".join(ran.text.strip().splitlines()[-1:])
        raise GseditError(f"{what}: code {ran.code}, {last}")
    return ran


def gsedit(*words: object) -> Ran:
    """Run a command of gsedit. Raises GseditError where it fails."""
    return must(clocked(sys.executable, "-m", "gsedit_cli", *words), f"gsedit {words[0]}")
