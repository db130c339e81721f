"""Two versions of gsedit side by side: seconds and errors of a list of commands, run in turns.

    python -m research.two_versions OLD NEW SCENE PHOTOS FOLDER [RUNS] [NAME ...]

OLD and NEW are checkouts. Commands of both alternate, so that what else the machine does meets both
alike. Prints medians and ratios, and marks what got worse by more than the spread of its own runs.
Rows are kept in FOLDER: a later run adds to them.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

from gsedit.bench.results import markdown_table

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


def run(tree: Path, words: list[str], out: Path) -> dict[str, Any]:
    """Run a command of one version: seconds, CPU seconds, exit code, decibels that it printed."""
    shutil.rmtree(out, ignore_errors=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    if words[words.index("-o") + 1] != str(out):
        out.mkdir()
    link = out.parent / "path" / "gsedit_cli"  # the package's name of the folder cli
    link.parent.mkdir(exist_ok=True)
    if not link.is_symlink():
        link.symlink_to(tree / "cli")
    environment = {**os.environ, "PYTHONPATH": f"{link.parent}:{tree}"}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", START, *words],
        capture_output=True, text=True, env=environment, cwd=out.parent, check=False,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    lines = done.stderr.splitlines()
    found = [float(m[1]) for line in lines[-6:] for m in PSNR.finditer(line)]
    return {
        "s": time.monotonic() - began, "CPU s": cpu, "code": done.returncode,
        "dB": found[-1] if found else None, "said": lines[-1] if done.returncode else "",
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Medians of both versions, ratios (below 1 is faster), and a mark."""
    cells: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        cells[row["name"]][row["version"]].append(row)
    lines = []
    for name, own in cells.items():
        old, new = (own.get(version, []) for version in ("old", "new"))
        if bad := [each["said"] for each in (*old, *new) if each["code"]]:
            lines.append([name, *[""] * 7, bad[0]])
            continue
        line, worse = [name], []
        for what in ("s", "CPU s"):
            a, b = ([each[what] for each in each_] for each_ in (old, new))
            ratio = median(b) / median(a)
            line += [f"{median(a):.1f}", f"{median(b):.1f}", f"{ratio:.2f}"]
            if len(b) > 2 and min(b) > max(a):  # beyond the spread of the runs
                worse.append(f"{what} x {ratio:.2f}")
        quality = [[e["dB"] for e in each if e["dB"] is not None] for each in (old, new)]
        line.append(" to ".join(f"{median(each):.2f}" for each in quality if each))
        if all(len(each) > 2 for each in quality) and max(quality[1]) < min(quality[0]) - 0.05:
            worse.append("dB")
        lines.append([*line, "**worse**: " + ", ".join(worse) if worse else ""])
    head = ("", "s old", "new", "ratio", "CPU s old", "new", "ratio", "dB", "")
    return markdown_table(head, lines)


def main(old: Path, new: Path, scene: Path, photos: Path, folder: Path, rest: list[str]) -> None:
    """Run the commands in turns, and print the table of all runs in the folder."""
    runs = int(rest.pop(0)) if rest and rest[0].isdigit() else 3
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "runs.jsonl"
    for turn in range(runs):
        for name in rest or COMMANDS:
            order = {"old": old, "new": new}
            for version in sorted(order, reverse=bool(turn % 2)):
                out = folder / version / name
                places = {"scene": scene, "photos": photos, "out": out}
                words = [w.format(**places).replace("+", " ") for w in COMMANDS[name].split()]
                row = {"name": name, "version": version, **run(order[version], words, out)}
                with file.open("a") as text:
                    text.write(json.dumps(row) + "\n")
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    print(table(rows))  # noqa: T201


if __name__ == "__main__":
    main(*(Path(each).absolute() for each in sys.argv[1:6]), sys.argv[6:])  # pyright: ignore[reportCallIssue]
