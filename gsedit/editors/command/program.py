"""A command line with fields, and the program that it starts, which never outlives its caller.

No shell is involved. The command is split once, as a shell would split it, and only then are
the FIELDS put in: whatever the instruction holds, it stays
inside one argument. (One that begins with a dash may still look like an option to the program:
`--prompt={prompt}` prevents that.)
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import IO

from gsedit.errors import UsageError

FIELDS = ("input", "output", "prompt", "seed", "renders", "masks", "python")
EXAMPLE = '--run "my_editor {input} {output} {prompt}"'
POLL = 0.1  # seconds between looks at a program, which works for seconds at least
GRACE = 3.0  # seconds between asking a program to stop and killing it


def split_command(run: str, known: Sequence[str] = FIELDS, example: str = EXAMPLE) -> list[str]:
    """The command as a list of words, fields in place. Raises UsageError if it is not valid, with
    the option that it was given as, which the example begins with."""
    option = example.split()[0]
    fields = re.findall(r"\{([a-z_]+)\}", run)
    for unknown in sorted(set(fields) - set(known)):
        names = ", ".join(f"{{{name}}}" for name in known)
        raise UsageError(f"{option} knows no {{{unknown}}}, only {names}")
    for needed in ("input", "output"):
        if needed not in fields:
            raise UsageError(
                f"{option} has no {{{needed}}}: say where the program finds the folder, "
                f"as in {example}"
            )
    try:
        return shlex.split(run)
    except ValueError as error:
        raise UsageError(f"{option} cannot be split into words ({error}): {run}") from None


def check_program(word: str, option: str = "--run") -> None:
    """Raise UsageError where there is no program of that name to run."""
    if word != "{python}" and shutil.which(word) is None:
        raise UsageError(
            f"there is no program {word!r} to run: install it, or give its whole path in "
            f"{option} (a script must be executable, or be given to its interpreter: "
            "'python script.py ...')"
        )


def fill_fields(words: list[str], values: Mapping[str, str]) -> list[str]:
    """The words with every field replaced by its value; each stays one argument."""
    pattern = re.compile("|".join(rf"\{{{name}\}}" for name in values))
    return [pattern.sub(lambda field: values[field[0][1:-1]], word) for word in words]


@contextmanager
def running(
    arguments: list[str], stdout: IO[bytes], stderr: IO[bytes]
) -> Iterator[subprocess.Popen[bytes]]:
    """The program, started; at the end of the block it and all it started are ended.

    Raises UsageError where it cannot be started.
    """
    program = _start(arguments, stdout, stderr)
    try:
        yield program
    finally:
        _end(program)


def wait(program: subprocess.Popen[bytes]) -> int | None:
    """The exit code, or None after POLL seconds."""
    try:
        return program.wait(POLL)
    except subprocess.TimeoutExpired:
        return None


def describe_exit(code: int) -> str:
    """How a program ended: with a code, or (negative) by a signal."""
    if code >= 0:
        return f"ended with code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was ended by {name}"


def _start(arguments: list[str], stdout: IO[bytes], stderr: IO[bytes]) -> subprocess.Popen[bytes]:
    """The program in a group of its own, so that what it starts can be ended with it."""
    try:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,  # a question would wait for ever
            stdout=stdout,  # not ours: results for other programs go there
            stderr=stderr,
            start_new_session=True,
        )
    except OSError as error:
        raise UsageError(
            f"{arguments[0]} cannot be started ({error.strerror}): is it executable?"
        ) from error


def _end(program: subprocess.Popen[bytes]) -> None:
    """End the program and all it started, unless it ended well: by SIGTERM, then by SIGKILL."""
    if program.poll() == 0:
        return
    try:
        _send(program, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            program.wait(GRACE)
    finally:
        _send(program, getattr(signal, "SIGKILL", signal.SIGTERM))
        program.wait()


def _send(program: subprocess.Popen[bytes], number: int) -> None:
    if not hasattr(os, "killpg"):  # Windows
        program.send_signal(number)
        return
    with suppress(ProcessLookupError):  # everything has ended meanwhile
        os.killpg(program.pid, number)
