"""The measured rows of README.md on three captures, by one script:

    python -m research.front_page CAPTURES -o OUT [--write-docs]

CAPTURES holds a folder for each of SUBJECTS: photos, their poses, and masks/NAME drawn by hand.
Each cell is one command in a process of its own. Cells are kept in OUT/cells.json: one that is
there is not measured again. --write-docs replaces the tables of README.md and of its page.
"""

from __future__ import annotations

import json
import re
import resource
import subprocess
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.results import commit, machine, markdown_table
from gsedit.errors import InputError
from research.command import Output, print_message, print_result, run

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", ROOT / "docs" / "measurements" / "front-page.md")
SUBJECTS = {"bear": "bear", "garden": "table", "dinosaur": "dino"}
"""Subject of each capture, as its folder of masks is called."""
CALLED = {"dino": "dinosaur"}
EDITS = {
    "material": ("turn the {} into bronze", "psnr_outside_masks", "all"),
    "removal": ("remove the {}", "psnr_outside_masks", "all"),
    "painting": ("like Van Gogh", "psnr_to_edits_alone", "held_out"),
}
"""By name: the sentence, the number that is shown, and its views."""
WHAT = {
    "fit": "fit of the photos, `--quality draft`: held-out photos of 512 pixels",
    "material": '`gsedit edit "turn the … into bronze"`: outside of outlines drawn by hand',
    "removal": '`gsedit edit "remove the …"`: outside of these outlines, shadows included',
    "painting": '`gsedit edit "like Van Gogh"`: to held-out views painted alone',
}
RENDER = "render and differentiate the garden, 648x420: gradients, worst input, to float64"
TAIL = 3000


def clocked(*words: object) -> tuple[str, float, float]:
    """(what a command prints, its seconds, its processor seconds). Raises InputError."""
    began, spent = time.perf_counter(), _spent()
    ran = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    if ran.returncode:
        raise InputError(f"{words}: {ran.stderr[-TAIL:]}")
    return ran.stdout + ran.stderr, time.perf_counter() - began, _spent() - spent


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def fit(capture: Path, out: Path) -> tuple[str, float, float]:
    """A fit that the edits begin with."""
    scene = out / capture.name / "scene.ply"
    text, seconds, cpu = clocked("gsedit", "fit", capture, "-o", scene, "--quality", "draft", "-f")
    return f"{re.findall(r'([0-9.]+) dB', text)[-1]} dB", seconds, cpu


def edit(name: str) -> Callable[[Path, Path], tuple[str, float, float]]:
    """An edit of the fit; masks that it did not know tell what is outside."""

    def measure(capture: Path, out: Path) -> tuple[str, float, float]:
        (sentence, number, role), subject = EDITS[name], SUBJECTS[capture.name]
        folder, record = out / capture.name / name, out / capture.name / f"{name}.json"
        said = sentence.format(CALLED.get(subject, subject))
        scene = out / capture.name / "scene.ply"
        _, seconds, cpu = clocked(
            "gsedit", "edit", scene, said, "--data", capture, "-o", folder, "-f"
        )
        masks = ("--subject-masks", capture / "masks" / subject) if "masks" in number else ()
        clocked("gsedit", "metrics", folder, *masks, "-o", record, "-f")
        found = json.loads(record.read_text())["measured"][number][role]
        within = found["interval"]
        ends = f"{found['views']} views" if within is None else "{:.1f} to {:.1f}".format(*within)
        return f"{found['value']:.1f} dB ({ends})", seconds, cpu

    return measure


ROWS = {"fit": fit, **{name: edit(name) for name in EDITS}}


def render(points: Path) -> str:
    """Milliseconds and errors of both kernels, by the goals of `gsedit bench`."""
    from gsedit.bench.renderer.speed import RUNS, cases, measure_case

    cells = (
        f"{each.kernel} {1000 * each.seconds:.0f} ms, error {each.gradient:.1e}"
        for each in measure_case(cases(points)[0], RUNS)
    )
    return "; ".join(cells)


def main(
    captures: Annotated[Path, typer.Argument(show_default=False)],
    out: Output,
    points: Annotated[Path | None, typer.Option("--points", help="garden.npz of gsplat.")] = None,
    docs: Annotated[
        bool, typer.Option("--write-docs", help="Write README.md and its page.")
    ] = False,
) -> None:
    """Measure the cells that are not there yet, and print the table."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / "cells.json"
    kept = json.loads(file.read_text()) if file.exists() else {}
    kept.setdefault("commit", commit())
    jobs = {f"{row} {name}": (measure, name) for row, measure in ROWS.items() for name in SUBJECTS}
    for key, (measure, name) in jobs.items():
        if key not in kept:
            print_message(key)
            kept[key] = measure(captures.absolute() / name, out.absolute())
            file.write_text(json.dumps(kept, indent=1) + "\n")
    if points is not None and "render" not in kept:
        kept["render"] = render(points)
    file.write_text(json.dumps(kept, indent=1) + "\n")
    rows = [(WHAT[row], *(_cell(*kept[f"{row} {name}"]) for name in SUBJECTS)) for row in ROWS]
    if "render" in kept:
        rows.append((RENDER, "", kept["render"], ""))
    when = datetime.now(UTC).date()
    where = f"{machine()}; commit {kept['commit']}; {when}. One run a cell."
    found = f"{markdown_table(('what', *SUBJECTS), rows)}\n\n{where}"
    for page in PAGES if docs else ():
        before, mark, rest = page.read_text("utf-8").partition("<!-- measured -->")
        after = rest.partition("<!-- end measured -->")
        page.write_text(f"{before}{mark}\n\n{found}\n\n{after[1]}{after[2]}", "utf-8")
    print_result(found)


def _cell(result: str, seconds: float, cpu: float) -> str:
    return f"{result}; {seconds:.{int(seconds < 20)}f} s ({cpu:.0f} s of processor)"


if __name__ == "__main__":
    run(main)
