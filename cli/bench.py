"""`gsedit bench`: error against run time of the renderer, extreme inputs, the promised bars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .command import as_command
from .console import print_json, print_message, print_result
from .exits import Interrupted
from .options import Common, Force, check_folder, output
from .progress import progress

if TYPE_CHECKING:
    from gsedit.bench.renderer.rows import Row
    from gsedit.bench.renderer.workloads import Workload

bench = typer.Typer(no_args_is_help=True, add_completion=False)

Points = Annotated[
    Path | None,
    typer.Option(
        "--points",
        metavar="FILE",
        envvar="GSEDIT_GARDEN",
        show_default=False,
        help="The garden's points: gsplat's test asset garden.npz.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer and smaller: a first look.")]
Folder = Annotated[Path, output("Folder for the results.")]


@bench.callback()
def describe() -> None:
    """Measure the renderer on this machine."""


def rasterizer(
    scenes: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="SCENE", show_default=False, help="Fitted scenes to measure too (.ply)."
        ),
    ] = None,
    out: Folder = Path("out/bench"),
    points: Points = None,
    knobs: Annotated[
        str | None,
        typer.Option(
            "--knobs",
            metavar="stop,tile,...",
            show_default="all",
            help="What is varied: floor, stop, tile, block, cull, compile, dtype, degree, "
            "resolution, baseline, peers.",
        ),
    ] = None,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Times are medians of so many.")] = 5,
    quick: Quick = False,
    compare: Annotated[
        Path | None,
        typer.Option(
            "--compare",
            metavar="bench.jsonl",
            show_default=False,
            help="Print the ratio to these earlier measurements.",
        ),
    ] = None,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Error against run time: bench.jsonl, bench.md and two plots, on scenes made here and given.

    gsedit bench rasterizer bear.ply --points garden.npz -o out/bench
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.measure import PIECES, QUICK_PIECES
    from gsedit.bench.renderer import rows as measured
    from gsedit.bench.renderer.sweep import KNOBS, Plan, parse_knobs, sweep

    chosen = tuple(KNOBS) if knobs is None else parse_knobs(knobs)
    earlier = None if compare is None else measured.read_rows(compare)
    workloads = workloads_of(scenes or [], points, quick=quick)
    plan = Plan(chosen, runs, quick=quick, pieces=QUICK_PIECES if quick else PIECES)
    for stale in ("bench.md", "image_error.png", "gradient_error.png"):  # of an earlier run
        (out / stale).unlink(missing_ok=True)
    journal = Journal(out / "bench.jsonl")
    journal.follow(sweep(workloads, plan, out / "references"), common)
    found = journal.rows
    write_results(out, found)
    compared = None if earlier is None else measured.comparison(found, earlier)
    print_message(f"{len(found)} measurements are in {out}; look at {out / 'image_error.png'}")
    files = ("bench.jsonl", "bench.md", "image_error.png", "gradient_error.png")
    record = {"folder": out, "rows": len(found), "files": [out / name for name in files]}
    told = [str(out / "bench.md")]
    if compared is not None:
        record["compared"] = compared
        told.insert(0, compared)
    print_result(record, "\n\n".join(told), as_json=common.json)


def stability(
    out: Folder = Path("out/stability"),
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Extreme inputs, one after the other: what is drawn, and how wrong it is.

    gsedit bench stability -o out/stability
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.renderer import stability as museum
    from gsedit.files import atomic_path
    from gsedit.reports.events import Event

    journal = Journal(out / "stability.jsonl")
    with keeping(journal), progress(as_json=common.json) as show:
        from time import perf_counter

        began = perf_counter()
        for row in museum.rows(quick=quick):
            journal.write(row)
            seconds = perf_counter() - began
            show(Event("stability", seconds, len(journal.rows), note=row.name))
    table = museum.table(journal.rows)
    with atomic_path(out / "stability.md", overwrite=True) as temporary:
        temporary.write_text(table + "\n", encoding="utf-8")
    print_message(f"{len(journal.rows)} cases are in {out}")
    record = {"folder": out, "rows": journal.rows}
    print_result(record, table, as_json=common.json)


def bars(
    points: Points = None,
    scenes: Annotated[
        list[Path] | None,
        typer.Argument(metavar="SCENE", show_default=False, help="Fitted scenes (.ply)."),
    ] = None,
    cache: Annotated[
        Path,
        typer.Option("--cache", metavar="FOLDER", help="Where the reference's pictures are kept."),
    ] = Path("out/bench/references"),
    quick: Quick = False,
    *,
    common: Common,
) -> None:
    """What the renderer promises, and whether it is so here. Ends well either way.

    gsedit bench bars --points garden.npz
    """
    common.apply()

    from gsedit.bench.renderer import targets as promised
    from gsedit.reports.events import Event

    size = promised.QUICK if quick else promised.FULL
    found = []
    with progress(as_json=common.json) as show:
        for item in promised.measure_bars(size, points, scenes or [], cache):
            if isinstance(item, Event):
                show(item)
            else:
                found.append(item)
    record = {"bars": found, "reached": sum(bar.reached is True for bar in found)}
    print_result(record, promised.table(found), as_json=common.json)


def sampler(
    out: Folder = Path("out/sampler"),
    runs: Annotated[int, typer.Option("--runs", min=1, help="Times are medians of so many.")] = 5,
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """The sampler: solvers on stiff problems, ways of agreeing, the sweep of T_end, our overhead.

    gsedit bench sampler -o out/sampler
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.sampler import rows as told
    from gsedit.bench.sampler.experiments import measure
    from gsedit.bench.sampler.plots import sweep_plot, work_precision
    from gsedit.files import atomic_path

    journal = Journal(out / "bench.jsonl")
    journal.follow(measure(quick=quick, runs=runs), common)
    table = told.table(journal.rows)
    with atomic_path(out / "bench.md", overwrite=True) as temporary:
        temporary.write_text(table, encoding="utf-8")
    work_precision(journal.rows, out / "evaluations.png", "evaluations", overwrite=True)
    work_precision(journal.rows, out / "seconds.png", "seconds", overwrite=True)
    sweep_plot(journal.rows, out / "t_end.png", overwrite=True)
    files = ("bench.jsonl", "bench.md", "evaluations.png", "seconds.png", "t_end.png")
    print_message(
        f"{len(journal.rows)} measurements are in {out}; look at {out / 'evaluations.png'}"
    )
    record = {"folder": out, "rows": len(journal.rows), "files": [out / name for name in files]}
    print_result(record, table, as_json=common.json)


for verb in (rasterizer, stability, bars, sampler):
    bench.command()(as_command(verb))


@dataclass
class Journal:
    """Rows as they are measured: each is on disk before the next one begins."""

    path: Path
    rows: list[Any] = field(default_factory=list)

    def write(self, row: Any) -> None:
        from gsedit.reports.json_lines import write_line

        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a" if self.rows else "w", encoding="utf-8") as file:
            write_line(file, row)
        self.rows.append(row)

    def follow(self, items: Iterable[Any], common: Common) -> None:
        """Show the events and write the rows, which --json prints too."""
        from gsedit.reports.events import Event

        with keeping(self), progress(as_json=common.json) as show:
            for item in items:
                if isinstance(item, Event):
                    show(item)
                    continue
                self.write(item)
                if common.json:
                    print_json("row", item)


@contextmanager
def keeping(journal: Journal) -> Iterator[None]:
    """Say what an interruption leaves behind."""
    try:
        yield
    except KeyboardInterrupt:
        count = len(journal.rows)
        kept = f"{count} rows are in {journal.path}" if count else "nothing was measured yet"
        raise Interrupted(f"interrupted; {kept}") from None


def workloads_of(scenes: list[Path], points: Path | None, *, quick: bool) -> list[Workload]:
    """The garden at two sizes if its points are at hand, the files, and scenes made here."""
    from gsedit.bench.renderer import workloads as make
    from gsedit.errors import UsageError

    fitted = [make.fitted(path) for path in dict.fromkeys(scenes)]
    names = [one.name for one in fitted]
    fitted = [  # rows are told apart by their scene's name
        replace(one, name=str(path)) if names.count(one.name) > 1 else one
        for one, path in zip(fitted, dict.fromkeys(scenes))
    ]
    if points is None:
        print_message("the garden is left out: give its points with --points FILE or GSEDIT_GARDEN")
    gardens = [] if points is None else [make.garden(scale, points) for scale in (0.25, 1.0)]
    found = [*gardens, *fitted, *make.synthetic()]
    if not found:
        raise UsageError("nothing to measure: name a scene file")
    return [make.smaller(one, 8) for one in found] if quick else found


def write_results(out: Path, rows: list[Row]) -> None:
    """The table and the plots."""
    from gsedit.bench.renderer.plots import work_precision
    from gsedit.bench.renderer.rows import table
    from gsedit.files import atomic_path

    with atomic_path(out / "bench.md", overwrite=True) as temporary:
        temporary.write_text(table(rows), encoding="utf-8")
    work_precision(rows, out / "image_error.png", "image", overwrite=True)
    work_precision(rows, out / "gradient_error.png", "gradients", overwrite=True)
