"""A second process that runs one function after the other.

Peak memory is measured there, above the memory of the inputs, and other renderers run there, which
may end their process. Functions are sent by name (they must be importable), arguments as pickles.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import torch

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class WorkerError(Exception):
    """A function raised in the worker's process, or that process ended."""


class Worker:
    """A process with as many torch threads as this one; it starts at the first call."""

    def __init__(self, **environment: str) -> None:
        """`environment`: variables of the process beside those of this one."""
        self._environment = environment
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self.end()

    def end(self) -> None:
        """Kill the process; the next call starts another."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """The result of `function(*args)` in that process. Keyword arguments: functools.partial.

        Raises WorkerError with one line on what went wrong.
        """
        process = self._started()
        assert process.stdin
        assert process.stdout
        try:
            pickle.dump((torch.get_num_threads(), function, args), process.stdin)
            process.stdin.flush()
            kind, result = pickle.load(process.stdout)
        except (BrokenPipeError, EOFError, pickle.UnpicklingError):
            process.wait()
            code, self._process = process.returncode, None
            how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            raise WorkerError(f"its process ended ({how})") from None
        if kind == "error":
            raise WorkerError(result)
        return result

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            self._process = subprocess.Popen(
                (sys.executable, "-m", "research.renderer.worker"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                    **self._environment,
                },
            )
        return self._process


def serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Run requested functions until there are no more requests."""
    while True:
        try:
            threads, function, args = pickle.load(requests)
            torch.set_num_threads(threads)
            reply = ("result", function(*args))
        except EOFError:
            return
        except Exception as error:
            reply = ("error", f"{type(error).__name__}: {' '.join(str(error).split())}")
        function = args = None
        pickle.dump(reply, replies)
        replies.flush()


def peak_memory(work: Callable[..., Any], *args: Any) -> int | None:
    """Bytes that `work(*args)` takes at its peak above the memory before; its result counts.

    Read from the kernel's high-water mark of this process (Linux), which is reset before. None
    where the system has none.
    """
    _trim()
    try:
        RESET.write_text("5")  # Linux: sets the high-water mark to what is resident now
        before = _resident("VmHWM")
        result = work(*args)
        after = _resident("VmHWM")
    except OSError:
        return None
    del result
    return max(0, after - before)


def _resident(field: str) -> int:
    """A line of this process's status, in bytes."""
    line = next(row for row in STATUS.read_text().splitlines() if row.startswith(field + ":"))
    return 1024 * int(line.split()[1])


def _trim() -> None:
    """Give freed memory back to the system: else work could reuse it unmeasured."""
    with contextlib.suppress(OSError, AttributeError):  # only the GNU C library has it
        ctypes.CDLL(None).malloc_trim(0)


def _main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent gets it too, and ends this process
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not mix with the replies
    serve(sys.stdin.buffer, replies)


if __name__ == "__main__":
    _main()
