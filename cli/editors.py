"""`gsedit editors`: which 2D editors there are, and what each still needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .console import print_message, print_result
from .options import Common

if TYPE_CHECKING:
    from gsedit.editors import Listing


def editors(*, common: Common) -> None:
    """List the 2D editors, of gsedit and of other packages, and what each needs to run.

    gsedit editors --json
    """
    common.apply()
    from gsedit.editors import list_editors

    for listing in list_editors():
        record = {**vars(listing), "ready": listing.ready}
        print_result(record, as_text(listing), as_json=common.json)
    if not common.json:
        print_message(
            "use one with: gsedit edit ... --editor NAME; add one: see examples/write_an_editor.py"
        )


def as_text(listing: Listing) -> str:
    """Its name and summary, and a line for each thing that is missing."""
    state = "ready" if listing.ready else "not ready"
    origin = f" (from {listing.source})" if listing.source != "gsedit" else ""
    lines = [f"{listing.name:<12} {state}{origin}", listing.summary]
    if listing.options:
        lines.append(f"takes {' '.join(listing.options)}")
    lines += [f"needs {need}" for need in listing.needs]
    return "\n    ".join(line for line in lines if line)
