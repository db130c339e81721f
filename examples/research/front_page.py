"""The measured rows of README.md, by one script: `python -m research.front_page PHOTOS -o OUT`.

Each row is one command in a process of its own: its seconds and its errors. Rows are kept in OUT: a
row that is there is not measured again. With --write-docs, the tables of the pages are replaced
between their markers.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.provenance import commit, machine
from gsedit.bench.renderer.speed import measure_speed
from gsedit.bench.results import markdown_table, write_text
from research.clocked import clocked, gsedit, must
from research.command import Output, Points, print_message, print_result, run
from research.measure_meters import write_masks
from research.paper.tables import write_page
from research.pose_error import pose_error, poses

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "measurements" / "front-page.md"
STATUE = "turn the bear into a bronze statue"
EDITS = {
    "material": ("bronze as a material", (STATUE,)),
    "small": ("bronze by `small`", (STATUE, "--editor", "small")),
    "removal": ("the bear removed", ("remove the bear",)),
}
"""By name: what it is called, and words of `gsedit edit`."""
APART = ("--no-consensus", "--noise", "independent")
MILLIONS = 10


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    result: str
    seconds: float | None
    cpu: float | None
    """Processor seconds, of all threads. None, and seconds, where the result says them."""
    command: str
    page: str
    """The page of docs/measurements that has more."""
    commit: str
    when: str


@dataclass(frozen=True)
class Places:
    """The inputs, and the folder of the results."""

    photos: Path
    garden: Path | None
    out: Path

    @property
    def bear(self) -> Path:
        return self.out / "bear.ply"


def row(
    what: str, result: str, spent: tuple[float | None, float | None], command: str, page: str
) -> Row:
    """A row of a command that is done; `spent`: its seconds and CPU seconds."""
    now = datetime.now(timezone.utc).isoformat(timespec="minutes")
    return Row(what, result, *spent, command, page, commit(), now)


def capture(places: Places) -> Row:
    """The poses of the bear's photos, against the published ones."""
    folder = places.out / "capture"
    ran = gsedit("capture", places.photos / "images", "-o", folder, "-f")
    error = pose_error(poses(folder), poses(places.photos))
    result = (
        f"{error.posed} of {error.photos} posed; {error.center:.2%} of the scene's size, "
        f"{error.degrees:.2f} degrees (median)"
    ).replace("%", " %")
    words = "gsedit capture photos/images"
    return row("capture of the bear's photos, poses unknown", result, ran.spent, words, "capture")


def fit(quality: str) -> Callable[[Places], Row]:
    """A fit of the bear; the draft is what the edits begin with."""

    def measure(places: Places) -> Row:
        scene = places.bear if quality == "draft" else places.out / f"{quality}.ply"
        ran = gsedit("fit", places.photos, "-o", scene, "--quality", quality, "-f")
        decibels = re.findall(r"(\d+\.\d+) dB", ran.text)[-1]
        result, words = f"{decibels} dB at held-out photos", f"gsedit fit --quality {quality}"
        return row(f"fit of the bear, `{quality}`", result, ran.spent, words, "fitting")

    return measure


def measured(record: Path, name: str, role: str) -> str:
    """A number of a record with its interval, dB; its number of views where these are too few."""
    found = json.loads(record.read_text())["measured"][name][role]
    within = found["interval"]
    views = f" ({found['views']} views)"
    ends = views if within is None else " ({:.1f} to {:.1f})".format(*within)
    return f"{found['value']:.1f} dB{ends}"


def edit(name: str) -> Callable[[Places], Row]:
    """An edit of the bear; what is outside is told by outlines drawn by hand."""

    def measure(places: Places) -> Row:
        (what, said), folder, record = EDITS[name], places.out / name, places.out / f"{name}.json"
        ran = gsedit("edit", places.bear, *said, "--data", places.photos, "-o", folder, "-f")
        write_masks(places.out / "masks")
        gsedit("metrics", folder, "--subject-masks", places.out / "masks", "-o", record, "-f")
        result = (
            f"outside of outlines drawn by hand {measured(record, 'psnr_outside_masks', 'all')}"
        )
        if name == "small":
            edits = measured(record, "psnr_to_edits_alone", "held_out")
            result = f"{edits} to edits of held-out views made alone; {result}"
        more = " ".join(said[1:])
        return row(what, result, ran.spent, f'gsedit edit "{said[0]}" {more}'.strip(), "regions")

    return measure


def truth(apart: bool) -> Callable[[Places], Row]:
    """An edit by the editor whose result is known."""

    def measure(places: Places) -> Row:
        folder, more = places.out / f"closed_form_{apart}", APART if apart else ()
        ran = gsedit(
            "edit", places.bear, STATUE, "--editor", "closed-form", "--data", places.photos,
            "-o", folder, "-f", *more,
        )  # fmt: skip
        result = measured(folder / "edit.json", "psnr_to_ground_truth", "held_out")
        what = "the same, views sharing neither noise nor consensus" if apart else (
            "edit whose true result is known"
        )  # fmt: skip
        words = " ".join(("gsedit edit --editor closed-form", *more))
        return row(what, f"{result} to it at held-out cameras", ran.spent, words, "consensus")

    return measure


def render(places: Places) -> Row:
    """The garden, forward and backward, by both kernels."""
    speeds = measure_speed(places.garden, 7, places.out / "references")
    one = {}
    for speed in speeds:
        if not speed.case.startswith("garden 648"):
            break
        one[speed.kernel] = speed
    fast, slow = one["compiled"], one["torch"]
    result = (
        f"{1000 * fast.seconds:.0f} ms compiled, {1000 * slow.seconds:.0f} ms torch (medians of "
        f"seven); errors to float64: colors {fast.error:.1e} (mean), gradients "
        f"{fast.gradient:.1e} (worst input)"
    ).replace("e-0", "e-")
    what = "render the garden, 648x420, forward and backward"
    return row(what, result, (None, None), "gsedit bench targets --points garden.npz", "renderer")


def convert(places: Places) -> Row:
    """Ten million Gaussians of SH degree 3 from .ply to .ply."""
    ran = clocked(
        sys.executable, "-m", "research.streaming_bench", places.out / "large", "--count",
        MILLIONS * 1_000_000, "--degree", 3, "--only", "gsedit convert .ply",
    )  # fmt: skip
    lines = must(ran, "research.streaming_bench").text.splitlines()
    (line,) = [each for each in lines if each.startswith("| gsedit convert")]
    cells = [cell.strip() for cell in line.strip("| ").split("|")]
    result = f"{float(cells[2]) / 1000:.2f} GB at most"
    what = f"convert {MILLIONS} million synthetic Gaussians, .ply to .ply"
    return row(what, result, (float(cells[1]), None), "gsedit convert", "formats")


def make(target: str) -> Callable[[Places], Row]:
    """A command of the Makefile, in the environment that is there."""

    def measure(_: Places) -> Row:
        ran = must(clocked("make", "-C", ROOT, target), f"make {target}")
        passed = re.findall(r"(\d+ passed.*?) in ", ran.text)
        result = passed[-1] if passed else "done"
        return row(f"make {target}", result, ran.spent, f"make {target}", "")

    return measure


ROWS: dict[str, Callable[[Places], Row]] = {
    "capture": capture,
    **{f"fit {quality}": fit(quality) for quality in ("draft", "normal")},
    **{name: edit(name) for name in EDITS},
    **{f"truth {apart}": truth(apart) for apart in (False, True)},
    "render": render,
    "convert": convert,
    **{f"make {target}": make(target) for target in ("demo", "test")},
}

SHOWN = ("capture", "fit draft", "material", "small", "render", "convert")
"""The rows of README.md."""


def table(rows: Sequence[Row], *, links: bool) -> str:
    """The rows for people; with links, as README.md has them."""
    head = ("what", "result", "time", *(() if links else ("CPU time",)), "command")
    lines = []
    for each in rows:
        page = f" ([page](docs/measurements/{each.page}.md))" if links else ""
        spent = (each.seconds,) if links else (each.seconds, each.cpu)
        cells = ("" if value is None else f"{value:.{int(value < 100)}f} s" for value in spent)
        lines.append((each.what, each.result, *cells, f"`{each.command}`{page}"))
    return markdown_table(head, lines)


def conditions(rows: Sequence[Row]) -> str:
    """The machine, the commits and the times of the rows."""
    commits, when = sorted({each.commit for each in rows}), sorted(each.when for each in rows)
    return f"{machine()}; commit {', '.join(commits)}; {when[0]} to {when[-1]}. One run a row."


def main(
    photos: Annotated[Path, typer.Argument(help="Folder of the bear's photos.")],
    out: Output,
    garden: Points = None,
    only: Annotated[list[str] | None, typer.Option("--only", help="Row; repeatable.")] = None,
    docs: Annotated[
        bool, typer.Option("--write-docs", help="Write README.md and the page.")
    ] = False,
) -> None:
    """Measure the rows that are not there yet, and print the table."""
    places, out = Places(photos, garden, out), out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    file, kept = out / "rows.json", {}
    if file.exists():
        kept = json.loads(file.read_text())
    for name in only or ROWS:
        if name not in kept:
            print_message(name)
            kept[name] = asdict(ROWS[name](places))
            write_text(file, json.dumps(kept, indent=1) + "\n")
    rows = [Row(**kept[name]) for name in ROWS if name in kept]
    found = {"front-page": table(rows, links=False), "conditions": conditions(rows)}
    if docs:
        write_page(PAGE, found)
        readme = ROOT / "README.md"
        shown = [Row(**kept[name]) for name in SHOWN if name in kept]
        front = {"measured": table(shown, links=True)}
        write_page(readme, front)
    print_result(found["front-page"])


if __name__ == "__main__":
    run(main)
