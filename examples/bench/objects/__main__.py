"""Measure what removes, moves, changes and selects objects, against exact truth.

    python -m bench.objects -o out/objects

Writes the scenes and their truth as files, objects.jsonl and objects.md. Files that are there are
used again; docs/howto/measure.md says how to measure your own results.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from research.command import Output, Quick, collect, print_result, run

from bench.objects.run import QUICK, Plan, objects_to_folder, table


def main(
    output: Output = Path("out/objects"),
    result: Annotated[Path | None, typer.Option(help="Folder of other results.")] = None,
    fitted: Annotated[bool, typer.Option("--fitted", help="Fit colors to photos.")] = False,
    quick: Quick = False,
) -> None:
    """Measure what removes, moves, changes and selects objects, against exact truth."""
    plan = QUICK if quick else Plan()
    plan = replace(plan, size=replace(plan.size, fitted=fitted))
    print_result(table(collect(objects_to_folder(output, plan, result))))


if __name__ == "__main__":
    run(main)
