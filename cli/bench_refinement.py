"""`gsedit bench refinement`: edits of extreme scenes and targets, beside the other benchmarks."""

from __future__ import annotations

from pathlib import Path

from .bench import Folder, Quick, bench, collect
from .command import as_command
from .console import print_message, print_result
from .options import Common, Force, check_folder


def refinement(
    out: Folder = Path("out/refinement"),
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Edit extreme scenes and targets, and print what they came to, or the message of a refusal.

    Writes refinement.jsonl and refinement.md.

    gsedit bench refinement -o out/refinement
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.refinement.run import ROWS, table, to_folder

    rows = collect(to_folder(out, quick=quick), common, out / ROWS)
    print_message(f"{len(rows)} cases are in {out}")
    print_result({"folder": out, "rows": rows}, table(rows), as_json=common.json)


bench.command()(as_command(refinement))
