"""Every defect of a scene file with the rows that have it: also of files that `load` refuses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from gsedit.formats.streams import SceneSource
from gsedit.formats.validity import invalid_rows
from gsedit.scene.table import concatenate_tables
from gsedit.toolkit.defects import (
    DEFECTS,
    DUPLICATE,
    INVALID,
    INVISIBLE,
    REASONS,
    USUAL,
    Defect,
    Limits,
    find_defects,
    fingerprints,
    invalid,
    invisible,
    repeated,
)


@dataclass(frozen=True, eq=False)
class Found:
    """The Gaussians with one defect."""

    defect: Defect
    rows: Int64[np.ndarray, " r"]
    """In the order of the file, from 0."""


@dataclass(frozen=True, eq=False)
class Report:
    """Defects that were found in a scene."""

    gaussians: int
    refused: int
    """Rows that make `load` refuse the file."""
    found: tuple[Found, ...]
    """The defects that some rows have: those of INVALID, then those of DEFECTS."""

    @property
    def defective(self) -> int:
        """Rows with any defect."""
        return len(np.unique(np.concatenate([f.rows for f in self.found]))) if self.found else 0


def check(source: SceneSource, limits: Limits = USUAL, *, quick: bool = False) -> Report:
    """Look for every defect that needs no cameras.

    `quick` leaves out those that depend on a Gaussian's neighbors; the file may then be larger
    than memory. Otherwise 64 bytes a Gaussian and the search tree are held.
    """
    parts: dict[str, list[np.ndarray]] = {defect.name: [] for defect in INVALID}
    parts |= {} if limits.invisible is None else {INVISIBLE.name: []}
    keys, flat = [], []
    count = refused = 0
    for block in source.blocks():
        bad = invalid_rows(block)
        refused += int(bad.sum())
        found = invalid(block) if bad.any() else {}
        if limits.invisible is not None:
            found[INVISIBLE.name] = invisible(block, limits.invisible) & ~bad
        for name, some in found.items():
            parts[name].append(count + np.flatnonzero(some))
        if limits.duplicates:
            keys.append(fingerprints(block))
        if not quick:
            flat.append(block.replace(sh=block.sh[:, :1].copy(), extra={}))
        count += len(block)
    none = np.zeros(0, np.int64)
    rows = {name: np.concatenate([none, *some]) for name, some in parts.items()}
    if keys:
        rows[DUPLICATE.name] = np.flatnonzero(repeated(np.concatenate(keys)))
    if flat:
        # what single rows show is known already, and does not count as a neighbor
        known = np.zeros(count, bool)
        known[np.concatenate([none, *rows.values()])] = True
        left = np.flatnonzero(~known)
        others = replace(limits, invisible=None, duplicates=False)
        why = find_defects(concatenate_tables(flat)[left], others)
        more = {name: left[why == number] for number, name in enumerate(REASONS)}
        rows = {**more, **rows}
    named = [(each, rows.get(each.name, none)) for each in (*INVALID, *DEFECTS)]
    return Report(count, refused, tuple(Found(*each) for each in named if len(each[1])))


ROWS_IN_A_LINE = 5
"""Rows that the line of a defect names; the record has all."""


def defect_record(report: Report) -> dict[str, Any]:
    """Return every defect with all its rows, for a program."""
    return {
        "gaussians": report.gaussians,
        "refused": report.refused,
        "defects": [
            {
                "name": each.defect.name,
                "law": each.defect.sentence,
                "reason": each.defect.reason,
                "mend": each.defect.mend,
                "count": len(each.rows),
                "rows": each.rows.tolist(),
            }
            for each in report.found
        ],
    }


def defect_table(path: Path, format: str, report: Report, quick: bool) -> str:
    """Return a line for each defect, then the commands that mend them."""
    lines = [f"{path}: {format}, {report.gaussians:,} Gaussians, {report.defective:,} with defects"]
    lines += [defect_line(each) for each in report.found]
    names = {each.defect.name for each in report.found}
    if report.refused:
        lines.append(
            f"{report.refused:,} rows are invalid and make other commands refuse the file: "
            f"gsedit clean {path} --repair -o REPAIRED.ply"
        )
    if any(not each.defect.mend.startswith("clean --repair") for each in report.found):
        first = "after that, " if report.refused else ""
        lines.append(f"{first}gsedit clean {path} -o CLEAN.ply removes the other defects")
    if not names:
        lines.append("no defect was found" + (" in single rows (--quick)" if quick else ""))
    return "\n".join(lines)


def defect_line(found: Found) -> str:
    """Return a defect with its count, its criterion and its first rows."""
    rows = ", ".join(map(str, found.rows[:ROWS_IN_A_LINE].tolist()))
    more = ", ..." if len(found.rows) > ROWS_IN_A_LINE else ""
    count = f"{len(found.rows):,}"
    return (
        f"  {found.defect.name:<11}{count:>9}  {found.defect.sentence}; {found.defect.mend} "
        f"(rows {rows}{more})"
    )
