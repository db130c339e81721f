"""`gsedit bench`: renderer and sampler, edge cases, targets, the experiments of the paper."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from .command import as_command
from .console import print_json, print_message, print_result
from .exits import Interrupted
from .options import Common, Data, Force, check_folder, output, parse_indices
from .progress import progress

if TYPE_CHECKING:
    from gsedit.reports.events import Event

bench = typer.Typer(no_args_is_help=True, add_completion=False)

Scenes = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="SCENE", show_default=False, help="Fitted scenes (.ply) to measure as well."
    ),
]
Points = Annotated[
    Path | None,
    typer.Option(
        "--points",
        metavar="FILE",
        envvar="GSEDIT_GARDEN",
        show_default=False,
        help="Points of the garden scene: garden.npz, a test asset of gsplat.",
    ),
]
Knobs = Annotated[
    str | None,
    typer.Option(
        "--knobs",
        metavar="stop,tile,...",
        show_default="all",
        help="Settings to vary, one at a time: floor, stop, tile, block, cull, kernel, dtype, "
        "degree, resolution, baseline, peers.",
    ),
]
Compare = Annotated[
    Path | None,
    typer.Option(
        "--compare",
        metavar="bench.jsonl",
        show_default=False,
        help="Print the ratios to the measurements of an earlier run.",
    ),
]
Cache = Annotated[
    Path,
    typer.Option("--cache", metavar="FOLDER", help="Folder that keeps the reference's pictures."),
]
Quick = Annotated[bool, typer.Option("--quick", help="A short run: fewer and smaller cases.")]
Runs = Annotated[int, typer.Option("--runs", min=1, help="Number of runs; times are medians.")]
Folder = Annotated[Path, output("Folder for the results.")]

Capture = Annotated[
    Path | None,
    typer.Argument(
        metavar="SCENE", show_default=False, help="A fitted capture (.ply) to edit as well."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", min=1, show_default="one a core", help="Runs at once, of one thread each."
    ),
]
Page = Annotated[
    Path | None,
    typer.Option(
        "--write-docs",
        metavar="PAGE.md",
        show_default=False,
        help="Replace the tables of this page, between its markers.",
    ),
]

Row = TypeVar("Row")


@bench.callback()
def describe() -> None:
    """Measure the renderer, the sampler and the strategies on this machine."""


def rasterizer(
    scenes: Scenes = None,
    out: Folder = Path("out/bench"),
    points: Points = None,
    knobs: Knobs = None,
    runs: Runs = 5,
    quick: Quick = False,
    compare: Compare = None,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Measure the renderer's error against its run time, on synthetic and given scenes.

    Writes bench.jsonl, bench.md and two plots.

    gsedit bench rasterizer bear.ply --points garden.npz -o out/bench
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.measure import PIECES, QUICK_PIECES
    from gsedit.bench.renderer import folders
    from gsedit.bench.renderer.measurements import comparison, read_measurements
    from gsedit.bench.renderer.settings import KNOBS, parse_knobs
    from gsedit.bench.renderer.sweep import SweepPlan
    from gsedit.bench.renderer.workloads import standard_workloads

    names = tuple(KNOBS) if knobs is None else parse_knobs(knobs)
    plan = SweepPlan(names, runs, quick=quick, pieces=QUICK_PIECES if quick else PIECES)
    earlier = None if compare is None else read_measurements(compare)
    if points is None:
        print_message("the garden is left out: give its points with --points FILE or GSEDIT_GARDEN")
    workloads = standard_workloads(scenes or [], points, quick=quick)
    items = folders.sweep_to_folder(out, workloads, plan)
    rows = collect(items, common, out / folders.SWEEP_ROWS, print_rows=True)
    print_message(f"{len(rows)} measurements are in {out}; look at {out / folders.IMAGE_PLOT}")
    files = [out / name for name in folders.SWEEP_FILES]
    record = {"folder": out, "rows": len(rows), "files": files}
    text = str(out / folders.SWEEP_TABLE)
    if earlier is not None:
        record["compared"] = comparison(rows, earlier)
        text = f"{record['compared']}\n\n{text}"
    print_result(record, text, as_json=common.json)


def stability(
    out: Folder = Path("out/stability"),
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Draw extreme inputs one by one, and print the errors, or the message of a refusal.

    Writes stability.jsonl and stability.md.

    gsedit bench stability -o out/stability
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.renderer import folders
    from gsedit.bench.renderer.stability import table

    items = folders.stability_to_folder(out, quick=quick)
    rows = collect(items, common, out / folders.STABILITY_ROWS)
    print_message(f"{len(rows)} cases are in {out}")
    print_result({"folder": out, "rows": rows}, table(rows), as_json=common.json)


def targets(
    points: Points = None,
    scenes: Scenes = None,
    cache: Cache = Path("out/bench/references"),
    quick: Quick = False,
    *,
    common: Common,
) -> None:
    """Print which targets of speed, accuracy and memory the renderer reaches on this machine.

    The exit code is 0 whether or not they are reached.

    gsedit bench targets --points garden.npz
    """
    common.apply()

    from gsedit.bench.renderer.targets import FULL, QUICK, measure_targets, table

    size = QUICK if quick else FULL
    rows = collect(measure_targets(size, points, scenes or [], cache), common)
    reached = sum(target.reached is True for target in rows)
    print_result({"targets": rows, "reached": reached}, table(rows), as_json=common.json)


def sampler(
    out: Folder = Path("out/sampler"),
    runs: Runs = 5,
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Measure the sampler: errors of its solvers, variants of consensus, its run time.

    Writes bench.jsonl, bench.md and three plots.

    gsedit bench sampler -o out/sampler
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.sampler import folder
    from gsedit.bench.sampler.measurements import table

    items = folder.sampler_to_folder(out, quick=quick, runs=runs)
    rows = collect(items, common, out / folder.ROWS, print_rows=True)
    print_message(f"{len(rows)} measurements are in {out}; look at {out / folder.EVALUATIONS_PLOT}")
    record = {"folder": out, "rows": len(rows), "files": [out / name for name in folder.FILES]}
    print_result(record, table(rows), as_json=common.json)


def paper(
    scene: Capture = None,
    data: Data = None,
    out: Folder = Path("out/paper"),
    jobs: Jobs = None,
    docs: Page = None,
    quick: Quick = False,
    *,
    common: Common,
) -> None:
    """Repeat the experiments of Efficient-NeRF2NeRF: strategies, consensus, losses, by error to an
    exact edit.

    Writes report.html, summary.json, tables.md, plots, and the runs. A run whose file is there is
    not repeated: an interrupted bench goes on.

    gsedit bench paper bear.ply --data photos/ -o out/paper
    """
    if docs is not None:
        check_page(docs)
    common.apply()

    from gsedit.bench.paper import folder
    from gsedit.bench.paper.studies import FULL, QUICK, capture_case, missing_strategies, studies

    size = QUICK if quick else FULL
    skipped = [] if scene and scene.exists() else [f"The capture is left out: {no_capture(scene)}."]
    capture = None if skipped else capture_case(str(scene), str(data or ""), size)
    if missing := missing_strategies():
        skipped.append(f"Strategies that are not there: {', '.join(missing)}.")
    for sentence in skipped:
        print_message(sentence)
    parts, at_once, said = studies(size, capture), jobs or os.cpu_count() or 1, " ".join(skipped)
    items = folder.paper_to_folder(out, size, parts, jobs=at_once, skipped=said)
    collect(items, common, out / folder.RUNS)
    if docs is not None:
        folder.write_docs(docs, out)
    record = {"folder": out, "report": out / folder.REPORT, "skipped": skipped}
    print_result(record, str(out / folder.REPORT), as_json=common.json)


def no_capture(scene: Path | None) -> str:
    """Why there is none."""
    if scene is None:
        return "name a fitted scene, as in gsedit bench paper bear.ply --data photos/"
    return f"{scene} is not there"


def check_page(page: Path) -> None:
    """Raise UsageError unless the page is there."""
    from gsedit.errors import UsageError

    if not page.is_file():
        raise UsageError(f"--write-docs {page} is not there: name the page whose tables to replace")


def scale(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", show_default=False, help="A fitted scene (.ply).")
    ],
    data: Data = None,
    out: Folder = Path("out/scale"),
    gaussians: Annotated[
        str,
        typer.Option(
            "--gaussians",
            metavar="N,N,...",
            help="Sizes of the scenes, about: each Gaussian is divided.",
        ),
    ] = "130000,1920000",
    degree: Annotated[
        int, typer.Option("--sh-degree", min=0, max=3, help="Of the scenes that are made.")
    ] = 3,
    instruction: Annotated[
        str, typer.Option("--instruction", help="What is edited.")
    ] = "turn it into a bronze statue",
    options: Annotated[
        str, typer.Option("--options", help="Further options of gsedit edit, in quotes.")
    ] = "",
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Measure the edit of a scene with more and more Gaussians: seconds, memory, error.

    Writes scale.jsonl, scale.md and the edits. The edits run one after the other, each in a process
    of its own; the scenes are removed.

    gsedit bench scale bear.ply --data photos/ -o out/scale
    """
    import shlex

    from gsedit.errors import UsageError

    check_folder(out, force)
    common.apply()
    if data is None:
        raise UsageError("bench scale edits captured views: name their folder with --data")
    if not all(number.strip().isdigit() for number in gaussians.split(",")):
        raise UsageError(f"--gaussians {gaussians} is no list of numbers, as in 130000,1920000")

    from gsedit.bench.scale import measure

    sizes = tuple(int(number) for number in gaussians.split(","))
    settings = measure.ScaleSettings(
        scene, data, instruction, sizes, degree, options=tuple(shlex.split(options))
    )
    rows = collect(measure.scale_to_folder(out, settings), common, out / measure.ROWS)
    record = {"folder": out, "rows": rows}
    print_result(record, measure.table(rows), as_json=common.json)


def ranks(
    out: Folder = Path("out/ranks"),
    counts: Annotated[
        str,
        typer.Option("--ranks", metavar="N,N,...", help="Numbers of ranks, of one thread each."),
    ] = "1,2",
    runs: Runs = 3,
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Measure what several processes gain: 2D editor, update and fit, with torchrun.

    Writes bench.jsonl and bench.md.

    gsedit bench ranks -o out/ranks
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench import ranks

    numbers = parse_indices(counts, "--ranks")
    items = ranks.ranks_to_folder(out, ranks=numbers, runs=runs, quick=quick)
    rows = collect(items, common, out / ranks.ROWS, print_rows=True)
    record = {"folder": out, "rows": len(rows)}
    print_result(record, ranks.table(rows), as_json=common.json)


for verb in (rasterizer, stability, targets, sampler, paper, scale, ranks):
    bench.command()(as_command(verb))


def collect(
    items: Iterator[Event | Row],
    common: Common,
    path: Path | None = None,
    *,
    print_rows: bool = False,
) -> list[Row]:
    """The rows of a benchmark; its events are shown meanwhile, and its rows with --json.

    `path`: where an interruption leaves the rows.
    """
    from gsedit.reports.events import Event

    rows: list[Row] = []
    try:
        with progress(as_json=common.json) as show:
            for item in items:
                if isinstance(item, Event):
                    show(item)
                    continue
                rows.append(item)
                if print_rows and common.json:
                    print_json("row", item)
    except KeyboardInterrupt:
        if path is None:
            raise
        remains = f"{len(rows)} rows are in {path}" if rows else "nothing was measured yet"
        raise Interrupted(f"interrupted; {remains}") from None
    return rows
