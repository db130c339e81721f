"""`gsedit bench fit`: fits of captures against seconds, beside the other benchmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .bench import Folder, Quick, collect
from .bench_refinement import bench
from .command import as_command
from .console import print_message, print_result
from .options import Common, Force, Size, check_folder

Datasets = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="DATASET",
        show_default=False,
        help="Folders of posed photos to fit as well: nerfstudio (transforms.json) or COLMAP.",
    ),
]
Seconds = Annotated[
    float, typer.Option("--seconds", min=0.1, help="Budget of each fit; measuring takes none.")
]
Synthetic = Annotated[
    int, typer.Option("--synthetic", min=0, max=2, help="Number of synthetic captures.")
]
Moments = Annotated[
    int, typer.Option("--moments", min=1, help="How many times each fit is measured.")
]


def fit(
    datasets: Datasets = None,
    out: Folder = Path("out/fit"),
    seconds: Seconds = 90.0,
    size: Size = 256,
    synthetic: Synthetic = 2,
    moments: Moments = 5,
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Measure fits on held-out photos against seconds: gsedit's recipe, and gsplat's default one
    with gsedit's renderer.

    Writes fit.jsonl, fit.md and fit.png, and keeps the photos of the synthetic captures.

    gsedit bench fit bear/ -o out/fit --seconds 90
    """
    check_folder(out, force, leftovers=["captures"])
    common.apply()

    from gsedit.bench.fit.run import PLOT, ROWS, BenchSettings, table, to_folder

    settings = BenchSettings(tuple(datasets or ()), synthetic, seconds, moments, size)
    if quick:
        settings = BenchSettings(settings.datasets, min(1, synthetic), 5.0, 2, min(size, 64), 16)
    rows = collect(to_folder(settings, out), common, out / ROWS)
    print_message(f"{len(rows)} measurements are in {out}; look at {out / PLOT}")
    print_result({"folder": out, "rows": rows}, table(rows), as_json=common.json)


bench.command()(as_command(fit))
