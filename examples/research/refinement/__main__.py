"""Edit extreme scenes and targets: `python -m research.refinement`."""

from __future__ import annotations

from pathlib import Path

from research.command import Output, Quick, collect, print_message, print_result, require_new, run
from research.refinement.run import table, to_folder


def refinement(out: Output = Path("out/refinement"), quick: Quick = False) -> None:
    """Edit extreme scenes and targets, and print how each ended, or the message of a refusal.

    Writes refinement.jsonl and refinement.md. --quick leaves out the two cases that take minutes.
    """
    require_new(out)
    rows = collect(to_folder(out, quick=quick))
    print_message(f"{len(rows)} cases are in {out}")
    print_result(table(rows))


if __name__ == "__main__":
    run(refinement)
