"""Measure fits on held-out photos against seconds: `python -m research.fit`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gsedit.fitting.settings import QUALITIES
from research.command import Output, Quick, collect, print_message, print_result, require_new, run
from research.fit.run import PLOT, BenchSettings, table, to_folder

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
Quality = Annotated[str, typer.Option("--quality", help="Preset of gsedit fit, but its budget.")]
Moments = Annotated[
    int, typer.Option("--moments", min=1, help="How many times each fit is measured.")
]
Size = Annotated[int, typer.Option("--size", min=1, help="Longer side of the photos, pixels.")]


def fit(
    datasets: Datasets = None,
    out: Output = Path("out/fit"),
    seconds: Seconds = 90.0,
    size: Size = 256,
    synthetic: Synthetic = 2,
    moments: Moments = 5,
    quality: Quality = "draft",
    quick: Quick = False,
) -> None:
    """Compare gsedit's recipe with gsplat's default one, both with gsedit's renderer.

    Writes fit.jsonl, fit.md and fit.png, and keeps the photos of the synthetic captures.
    """
    require_new(out)
    if quality not in QUALITIES:
        raise typer.BadParameter(f"{quality}: one of {', '.join(QUALITIES)}")
    recipe = QUALITIES[quality].settings
    settings = BenchSettings(tuple(datasets or ()), synthetic, seconds, moments, size, fit=recipe)
    if quick:
        short = {"synthetic": min(1, synthetic), "seconds": 5.0, "moments": 2, "views": 16}
        settings = replace(settings, **short, size=min(size, 64))
    rows = collect(to_folder(settings, out))
    print_message(f"{len(rows)} measurements are in {out}; look at {out / PLOT}")
    print_result(table(rows))


if __name__ == "__main__":
    run(fit)
