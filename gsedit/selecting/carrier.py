"""The carrier of the things of a scene, as a table is."""

from __future__ import annotations

from collections import Counter

from gsedit.regions.region import Region
from gsedit.selecting.segment import Segments


def carrier(segments: Segments) -> Region | None:
    """The thing that most other things stand on, as a table; None where none is stood on."""
    rows = {row.number: row for row in segments.rows if row.kind == "object"}
    carried = Counter(row.stands_on for row in rows.values() if row.stands_on in rows)
    if not carried:
        return None
    most = max(carried, key=lambda number: (carried[number], rows[number].size))
    return Region(segments.inside(most), f"what carries {carried[most]} things")
