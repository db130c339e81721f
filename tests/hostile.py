"""Commands on hostile and extreme input: each ends with an answer or one clear line.

    PYTHONPATH=tests python tests/hostile.py [EVERY] [KIND ...]

EVERY 10 runs every tenth case; kinds are those of the table.

Every case is a `gsedit` command in a folder of its own. It is clean where the exit code is 0, 2 or
3, the last line is gsedit's, no Python warning and no control character is printed, and no file
outside `out/` is made, changed or removed. Prints a table by kind, then each failure; exit code 1
if there is one. Not a test of pytest: it takes minutes. Only what may end the process has a process
of its own. JOBS processes share the cases; VERBOSE prints each.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from command_line import gsedit
from hostile_cases import all_cases
from hostile_cases.base import Case

CPU_S, WALL_S = 60, 240
"""Longest run of a command, seconds: of the processor, and of the clock where it waits."""
CLEAN = (0, 2, 3)
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\x80-\x9f]")
WARNING = re.compile(r"^\S+\.py:\d+: \w*Warning|Traceback|<frozen ", re.MULTILINE)


class Hang(BaseException):
    """A command that does not end."""


@dataclass(frozen=True)
class Ended:
    """Exit code and output of a command."""

    code: int
    printed: str
    last: str


def main(every: int, kinds: list[str]) -> int:
    """Run every so-many-th case, or those of some kinds, and print the table; 1 if any is not
    clean."""
    torch.set_num_threads(1)
    warnings.simplefilter("always")  # not only the first at each line
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder).resolve()
        chosen = [
            (number, case)
            for number, case in enumerate(all_cases(base / "given"))
            if number % every == 0 and (not kinds or case.kind in kinds)
        ]
        jobs = int(os.environ.get("JOBS", os.cpu_count() or 1))
        works = [partial(judge_all, chosen[job::jobs], base) for job in range(jobs)]
        verdicts = [result for result, _ in in_copies(works)]
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    failures = []
    for kind, name, what, told in (each for share in verdicts for each in share or ()):
        counts[kind][what] += 1
        if what not in ("done", "refused"):
            failures.append(f"{kind}: {name}: {what}: {told}")
    _print(counts, failures)
    return int(bool(failures) or None in verdicts)


def judge_all(cases: list[tuple[int, Case]], base: Path) -> list[tuple[str, str, str, str]]:
    """Run cases, each in a new folder; their kind, name, verdict (done, refused or what is wrong)
    and last line."""
    verdicts = []
    for number, case in cases:
        # deep enough that names with a few `..` end inside what is watched
        arena = base / f"{number:04d}/a/b/c/d"
        arena.mkdir(parents=True)
        began = time.monotonic()
        what, told = judge(case, arena, base / f"{number:04d}")
        verdicts.append((case.kind, case.name, what, told))
        if os.environ.get("VERBOSE") or what not in ("done", "refused"):
            seconds = time.monotonic() - began
            sys.stderr.write(f"{seconds:6.1f} s {case.kind}: {case.name}: {what}: {told}\n")
        shutil.rmtree(base / f"{number:04d}", ignore_errors=True)
    return verdicts


def _print(counts: dict[str, dict[str, int]], failures: list[str]) -> None:
    columns = ("done", "refused")
    sys.stdout.write("kind                 done refused failed\n")
    totals = [0, 0, 0]
    for kind, found in counts.items():
        row = [*(found[each] for each in columns)]
        row.append(sum(found.values()) - sum(row))
        totals = [a + b for a, b in zip(totals, row)]
        sys.stdout.write(f"{kind:20} {row[0]:4} {row[1]:7} {row[2]:6}\n")
    sys.stdout.write(f"{'all':20} {totals[0]:4} {totals[1]:7} {totals[2]:6}\n")
    for failure in failures:
        sys.stdout.write(f"{failure}\n")


def judge(case: Case, arena: Path, watched: Path) -> tuple[str, str]:
    """Run a case in a folder: (done, refused or what is wrong, the last line)."""
    words = [str(word) for word in case.make(arena)]
    (arena / "out").mkdir(exist_ok=True)
    before = _snapshot(watched, arena / "out")
    with contextlib.chdir(arena):
        try:
            ended = _ended_by(case, words)
        except Hang:
            return "hang", " ".join(words)[:200]
    changed = _changes(before, _snapshot(watched, arena / "out"))
    if changed:
        return "write outside", ", ".join(changed[:4])
    return _verdict(ended, words, case.disk > 0)


def _ended_by(case: Case, words: list[str]) -> Ended:
    """Run a case's command where it is to run. Raises Hang."""
    if case.disk:
        return _in_copy(lambda: _on_disk(words, case.disk))
    if case.apart == "fork":
        return _in_copy(lambda: _here(words))
    return (_in_process if case.apart else _here)(words)


def _verdict(ended: Ended, words: list[str], is_full: bool) -> tuple[str, str]:
    """Name what is wrong with an end, if anything is."""
    told = CONTROL.sub("?", ended.last)[:300]
    if ended.code < 0 or ended.code >= 128:
        return "crash", f"exit code {ended.code}"
    if "internal error" in ended.printed:
        return "internal error", told
    may_fail = is_full or "--check" in words  # there, 1 says that there are defects
    if ended.code not in CLEAN and not (may_fail and ended.code == 1):
        return f"exit code {ended.code}", told
    if warning := WARNING.search(ended.printed):
        return "Python warning", warning[0]
    if CONTROL.search(ended.printed):
        return "control character", told
    # typer's names of the program in a test and in a process
    is_told = ended.last.startswith(("gsedit", "root", "python -m gsedit_cli"))
    if ended.code and "--check" not in words and not is_told:
        return "no line", told
    return ("refused" if ended.code else "done"), told


def _here(words: list[str]) -> Ended:
    """Run a command in this process. Raises Hang."""
    with _at_most():
        result = gsedit(*words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        name = f"internal error ({type(result.exception).__name__}: {result.exception})"
        return Ended(1, name, name)
    return _ended(result.exit_code, result.stdout, result.stderr)


def _on_disk(words: list[str], size: int) -> Ended:
    """Run a command with a disk of some bytes under out/, which no other process sees. A temporary
    file that is left there is an internal error."""
    private_mounts = 0x20000
    if ctypes.CDLL(None, use_errno=True).unshare(private_mounts):
        return Ended(2, "", "gsedit: not run: only root has a disk of its own")
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", "out"], check=True)
    ended = _here(words)
    left = [path.name for path in Path("out").rglob(".gs-*")]
    return Ended(1, f"internal error: left {left}", str(left)) if left else ended


def _in_copy(work: Callable[[], Ended]) -> Ended:
    """Run a command in a copy of this process. Raises Hang."""
    [(result, number)] = in_copies([lambda: vars(work())])
    if number:
        return Ended(-number, "", "")
    if result is None:
        raise Hang
    return Ended(**result)


def in_copies(works: list[Callable[[], Any]]) -> list[tuple[Any, int]]:
    """Run functions in copies of this process at a time: what they return, as JSON holds it (None
    for one that raised), and the number of the signal that ended it (0 for none)."""
    with contextlib.ExitStack() as files:
        started = []
        for work in works:
            report = files.enter_context(tempfile.TemporaryFile("w+"))
            if (child := os.fork()) == 0:
                try:
                    json.dump(work(), report)
                    report.flush()
                except BaseException as error:
                    sys.stderr.write(f"{error!r}\n" * (not isinstance(error, Hang)))
                os._exit(0)
            started.append((child, report))
        results = []
        for child, report in started:
            _, status = os.waitpid(child, 0)
            report.seek(0)
            text = report.read()
            ended_by = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
            results.append((json.loads(text) if text else None, ended_by))
        return results


def _in_process(words: list[str]) -> Ended:
    """Run a command in a process of its own. Raises Hang."""
    command = [sys.executable, "-m", "gsedit_cli", *words]
    try:
        done = subprocess.run(command, capture_output=True, timeout=WALL_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise Hang from error
    texts = (each.decode(errors="replace") for each in (done.stdout, done.stderr))
    return _ended(done.returncode, *texts)


def _ended(code: int, out: str, err: str) -> Ended:
    lines = err.strip().splitlines() or [""]
    return Ended(code, f"{out}{err}", lines[-1])


@contextlib.contextmanager
def _at_most() -> Iterator[None]:
    """Raise Hang in a computation that takes longer."""

    def stop(*_: object) -> None:
        raise Hang

    timers = (
        (signal.SIGPROF, signal.ITIMER_PROF, CPU_S),
        (signal.SIGALRM, signal.ITIMER_REAL, WALL_S),
    )
    for number, timer, seconds in timers:
        signal.signal(number, stop)
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for _, timer, _ in timers:
            signal.setitimer(timer, 0)


def _snapshot(folder: Path, left_out: Path) -> dict[Path, str]:
    """Digest every file and link below a folder, but for what is in `left_out`."""
    found = {}
    for path in folder.rglob("*"):
        if path == left_out or left_out in path.parents:
            continue
        if path.is_symlink():
            found[path] = os.readlink(path)
        elif path.is_file():
            found[path] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[path] = "no file"
    return found


def _changes(before: dict[Path, str], after: dict[Path, str]) -> list[str]:
    """List what was made, changed or removed."""
    paths = sorted({*before, *after})
    return [path.name for path in paths if before.get(path) != after.get(path)]


if __name__ == "__main__":
    given = sys.argv[1:]
    number = int(given.pop(0)) if given and given[0].isdigit() else 1
    sys.exit(main(number, given))
