"""Size and time of an install in an empty environment, and its first edit without a compiler.

    python -m research.measure_install . --extras mesh,plots
    python -m research.measure_install dist/gsedit-*.whl --scene bear.ply

WHAT is a tree or a wheel; torch has the version of constraints.txt. pip's cache is not used: all is
downloaded and unpacked. With --scene the installed command edits that scene twice, by
an environment that has no PATH but its own and an empty home: the first run is a user's first.
Prints a row of the table in docs/howto/install.md for each.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from research.command import print_result, run

ROOT = Path(__file__).parents[2]
INSTRUCTION = "paint it red"


class Took(NamedTuple):
    """Seconds of a command, by the clock and of its processors."""

    wall: float
    cpu: float

    def __str__(self) -> str:
        return f"{self.wall:.0f} s | {self.cpu:.1f} s"


def measure(
    what: Annotated[Path, typer.Argument(help="A tree with pyproject.toml, or a wheel.")],
    extras: Annotated[str, typer.Option(help="Names of extras, separated by commas.")] = "",
    scene: Annotated[Path | None, typer.Option(help="A scene to edit.")] = None,
) -> None:
    """Install, and print what it took."""
    with tempfile.TemporaryDirectory() as place:
        home = Path(place) / "env"
        venv.create(home, with_pip=True)
        before = bytes_of(home)
        alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        target = f"{what.resolve()}[{extras}]" if extras else str(what.resolve())
        pip = [home / "bin/python", "-m", "pip", "install", "--quiet", "--no-cache-dir"]
        took = timed([*pip, "--constraint", ROOT / "constraints.txt", target], alone)
        listed = subprocess.run(
            [home / "bin/python", "-m", "pip", "list", "--format=freeze"],
            env=alone, capture_output=True, text=True, check=True,
        )  # fmt: skip
        size, count = (bytes_of(home) - before) / 1e6, len(listed.stdout.split()) - 2
        print_result(f"| {what.name} | {extras or 'none'} | {count} | {size:,.0f} MB | {took} |")
        if scene is not None:
            for name in ("first", "second"):
                print_result(f"| {name} run of an edit | {edit(home, scene.resolve(), name)} |")


def edit(home: Path, scene: Path, name: str) -> Took:
    """Edit a scene with the command of an environment, where no compiler can be found."""
    alone = {"PATH": str(home / "bin"), "HOME": str(home), "OMP_NUM_THREADS": "1"}
    words = [home / "bin/gsedit", "edit", scene, INSTRUCTION, "-o", home / f"out-{name}"]
    return timed(words, alone)


def timed(words: list[str | Path], environment: dict[str, str]) -> Took:
    """Run a command to its end. Raises CalledProcessError."""
    began, spent = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([str(word) for word in words], env=environment, check=True, stdout=sys.stderr)
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = now.ru_utime + now.ru_stime - spent.ru_utime - spent.ru_stime
    return Took(time.monotonic() - began, cpu)


def bytes_of(folder: Path) -> int:
    """Count the bytes of all files below a folder."""
    files = (each for each in folder.rglob("*") if each.is_file() and not each.is_symlink())
    return sum(each.stat().st_size for each in files)


if __name__ == "__main__":
    run(measure)
