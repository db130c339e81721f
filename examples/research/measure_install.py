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
import tempfile
import venv
from pathlib import Path
from typing import Annotated

import typer

from research.clocked import Ran, clocked, must
from research.command import print_result, run

ROOT = Path(__file__).parents[2]
INSTRUCTION = "paint it red"


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
        words = [*pip, "--constraint", ROOT / "constraints.txt", target]
        took = _spent(must(clocked(*words, environment=alone), "pip"))
        freeze = [home / "bin/python", "-m", "pip", "list", "--format=freeze"]
        listed = must(clocked(*freeze, environment=alone), "pip")
        size, count = (
            (bytes_of(home) - before) / 1e6,
            sum("==" in line or " @ " in line for line in listed.text.splitlines()) - 2,
        )
        print_result(f"| {what.name} | {extras or 'none'} | {count} | {size:,.0f} MB | {took} |")
        if scene is not None:
            for name in ("first", "second"):
                print_result(
                    f"| {name} run of an edit | {_spent(edit(home, scene.resolve(), name))} |"
                )


def edit(home: Path, scene: Path, name: str) -> Ran:
    """Edit a scene with the command of an environment, where no compiler can be found."""
    alone = {"PATH": str(home / "bin"), "HOME": str(home), "OMP_NUM_THREADS": "1"}
    words = [home / "bin/gsedit", "edit", scene, INSTRUCTION, "-o", home / f"out-{name}"]
    return must(clocked(*words, environment=alone), "the edit")


def _spent(ran: Ran) -> str:
    return f"{ran.seconds:.0f} s | {ran.cpu:.1f} s"


def bytes_of(folder: Path) -> int:
    """Count the bytes of all files below a folder."""
    files = (each for each in folder.rglob("*") if each.is_file() and not each.is_symlink())
    return sum(each.stat().st_size for each in files)


if __name__ == "__main__":
    run(measure)
