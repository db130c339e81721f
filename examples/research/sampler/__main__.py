"""Measure the sampler: `python -m research.sampler`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from research.command import Output, Quick, collect, print_message, print_result, require_new, run
from research.sampler.folder import EVALUATIONS_PLOT, sampler_to_folder
from research.sampler.measurements import table


def sampler(
    out: Output = Path("out/sampler"),
    runs: Annotated[int, typer.Option(min=1, help="Number of runs; times are medians.")] = 5,
    quick: Quick = False,
) -> None:
    """Measure the errors of the solvers, variants of consensus, and run time.

    Writes bench.jsonl, bench.md and three plots.
    """
    require_new(out)
    rows = collect(sampler_to_folder(out, quick=quick, runs=runs))
    print_message(f"{len(rows)} measurements are in {out}; look at {out / EVALUATIONS_PLOT}")
    print_result(table(rows))


if __name__ == "__main__":
    run(sampler)
