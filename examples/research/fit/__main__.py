"""Measure fits on held-out photos against seconds: `python -m research.fit`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gsedit.capture.fitting.settings import QUALITIES
from research.command import Output, Quick, collect, print_message, print_result, require_new, run
from research.fit.run import PLOT, BenchSettings, table, to_folder

Datasets = Annotated[
    list[Path] | None,
    typer.Argument(metavar="DATASET", help="Folders of posed photos with points to fit as well."),
]
AtLeast1 = Annotated[int, typer.Option(min=1)]


def fit(
    datasets: Datasets = None,
    out: Output = Path("out/fit"),
    seconds: Annotated[float, typer.Option(min=0.1)] = 90.0,
    size: AtLeast1 = 256,
    synthetic: Annotated[int, typer.Option(min=0, max=2)] = 2,
    moments: AtLeast1 = 5,
    quality: str = "draft",
    quick: Quick = False,
) -> None:
    """Compare gsedit's recipe with gsplat's default one, both with gsedit's renderer.

    Each fit has so many `seconds` and is measured at `moments`; photos have a longer side of
    `size`; at most two `synthetic` captures. Writes fit.jsonl, fit.md and fit.png, and keeps the
    photos of the synthetic captures.
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
