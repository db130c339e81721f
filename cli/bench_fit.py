"""`gsedit bench fit`: fits of captures against seconds, beside the other benchmarks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from .bench import Folder, Quick, collect
from .bench_refinement import bench
from .command import as_command
from .console import print_message, print_result
from .fit import Level
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
Preset = Annotated[
    Level,
    typer.Option(
        "--quality", metavar="draft|normal|high", help="Of gsedit's recipe, but its budget."
    ),
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
    quality: Preset = Level.DRAFT,
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
    from gsedit.fitting.settings import QUALITIES

    settings = BenchSettings(
        tuple(datasets or ()),
        synthetic,
        seconds,
        moments,
        size,
        fit=QUALITIES[quality.value].settings,
    )
    if quick:
        short = {"synthetic": min(1, synthetic), "seconds": 5.0, "moments": 2, "views": 16}
        settings = replace(settings, **short, size=min(size, 64))
    rows = collect(to_folder(settings, out), common, out / ROWS)
    print_message(f"{len(rows)} measurements are in {out}; look at {out / PLOT}")
    print_result({"folder": out, "rows": rows}, table(rows), as_json=common.json)


bench.command()(as_command(fit))
