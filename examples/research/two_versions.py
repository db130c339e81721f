"""Two versions of gsedit side by side: seconds and errors of a list of commands, run in turns.

    python -m research.two_versions OLD NEW SCENE PHOTOS -o out/versions --write-docs

OLD and NEW are checkouts. Commands of both alternate, so that what else the machine does meets both
alike. A table has medians and ratios, and marks what got worse by more than the spread of its own
runs. Rows are kept in the folder: a later run adds to them.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections import defaultdict
from itertools import product
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import typer

from gsedit.bench.provenance import provenance
from gsedit.bench.results import markdown_table
from research.clocked import clocked, must
from research.command import Output, print_result, run
from research.paper.tables import write_page

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "error-time.md"

COMMANDS = {
    "tone": "edit {scene} warmer --data {photos} -o {out}",
    "paint": "edit {scene} paint+the+bear+red --data {photos} -o {out}",
    "bronze": "edit {scene} turn+the+bear+into+bronze --data {photos} -o {out}",
    "snow": "edit {scene} make+it+snow --data {photos} -o {out}",
    "night": "edit {scene} at+night --data {photos} -o {out}",
    "small": "edit {scene} as+a+watercolor --editor small --data {photos} -o {out}",
    "remove": "edit {scene} remove+the+bear --data {photos} -o {out}",
    "fit": "fit {photos} -o {out}/scene.ply --minutes 0.5",
    "render": "render {scene} -o {out}",
    "convert": "convert {scene} -o {out}/scene.sog",
    "mesh": "mesh {scene} --region auto -o {out}/mesh.ply",
}
START = "from gsedit_cli.main import main; main()"
PSNR = re.compile(r"(\d+\.\d+) dB")


def run_one(tree: Path, words: list[str], out: Path) -> dict[str, Any]:
    """Run a command of one version: seconds, CPU seconds, exit code, decibels that it printed."""
    shutil.rmtree(out, ignore_errors=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    if words[words.index("-o") + 1] != str(out):
        out.mkdir()
    link = out.parent / "path" / "gsedit_cli"  # the package's name of the folder cli
    link.parent.mkdir(exist_ok=True)
    link.unlink(missing_ok=True)
    link.symlink_to(tree / "cli")
    environment = {**os.environ, "PYTHONPATH": f"{link.parent}:{tree}"}
    ran = clocked(sys.executable, "-c", START, *words, environment=environment, folder=out.parent)
    lines = ran.text.splitlines()
    found = [float(m[1]) for line in lines[-6:] for m in PSNR.finditer(line)]
    return {
        "s": ran.seconds, "CPU s": ran.cpu, "GB": ran.gigabytes, "code": ran.code,
        "dB": found[-1] if found else None, "said": " ".join(lines[-1:]) if ran.code else "",
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Medians of both versions, ratios (below 1 is faster), and a mark."""
    cells: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        cells[row["name"]][row["version"]].append(row)
    lines = []
    for name, own in cells.items():
        old, new = (own.get(version, []) for version in ("old", "new"))
        if not (old and new):  # interrupted
            continue
        if bad := [each["said"] for each in (*old, *new) if each["code"]]:
            lines.append([name, *[""] * 10, bad[0]])
            continue
        line, worse = [name], []
        for what, digits in (("s", 1), ("CPU s", 1), ("GB", 2)):
            a, b = ([each[what] for each in each_] for each_ in (old, new))
            ratio = median(b) / median(a)
            line += [f"{median(a):.{digits}f}", f"{median(b):.{digits}f}", f"{ratio:.2f}"]
            if len(b) > 2 and min(b) > max(a):  # beyond the spread of the runs
                worse.append(f"{what} x {ratio:.2f}")
        quality = [[e["dB"] for e in each if e["dB"] is not None] for each in (old, new)]
        line.append(" to ".join(f"{median(each):.2f}" for each in quality if each))
        if all(len(each) > 2 for each in quality) and max(quality[1]) < min(quality[0]) - 0.05:
            worse.append("dB")
        lines.append([*line, "**worse**: " + ", ".join(worse) if worse else ""])
    head = ("", "s old", "new", "ratio", "CPU s old", "new", "ratio", "GB old", "new", "ratio",
            "dB", "")  # fmt: skip
    return markdown_table(head, lines)


def main(
    old: Annotated[Path, typer.Argument(help="Checkout of a version.")],
    new: Annotated[Path, typer.Argument(help="Checkout of a later one.")],
    scene: Annotated[Path, typer.Argument(help="A fitted scene (.ply).")],
    photos: Annotated[Path, typer.Argument(help="Folder of its photos.")],
    out: Output,
    runs: Annotated[int, typer.Option("--runs", help="Runs of each command.")] = 3,
    only: Annotated[list[str] | None, typer.Option("--only", help="Command; repeatable.")] = None,
    docs: Annotated[bool, typer.Option("--write-docs", help="Write the page.")] = False,
) -> None:
    """Run the commands in turns, and print the table of all runs in the folder."""
    out.mkdir(parents=True, exist_ok=True)
    file, order = out / "runs.jsonl", {"old": old.absolute(), "new": new.absolute()}
    places = {"scene": scene.absolute(), "photos": photos.absolute()}
    for turn, name in product(range(runs), only or COMMANDS):
        for version in sorted(order, reverse=bool(turn % 2)):
            result = out.absolute() / version / name
            words = COMMANDS[name].format(**places, out=result).split()
            words = [word.replace("+", " ") for word in words]
            row = {"name": name, "version": version, **run_one(order[version], words, result)}
            with file.open("a") as text:
                text.write(json.dumps(row) + "\n")
    found = table([json.loads(line) for line in file.read_text().splitlines()])
    print_result(found)
    if docs:
        commits = " and ".join(f"{name} {commit_of(tree)}" for name, tree in order.items())
        made = {"versions-conditions": f"{provenance()} Versions: {commits}.", "versions": found}
        write_page(PAGE, made)


def commit_of(tree: Path) -> str:
    """The commit of a checkout, with a + where files differ from it."""
    words = ("git", "-C", tree, "describe", "--always", "--dirty=+", "--exclude=*")
    return must(clocked(*words), "git").text.strip()


if __name__ == "__main__":
    run(main)
