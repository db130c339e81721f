"""Every defect of a scene file with the rows that have it: also of files that `load` refuses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from gsedit.formats.streams import SceneSource, gather
from gsedit.formats.validity import invalid_rows
from gsedit.scene.table import SPLAT_FIELDS, SplatTable
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
    scan = _Scan(limits)
    if quick:
        for _ in scan.blocks(source):
            pass
        whole = None
    else:
        flat = source.header.replace(degree=0, extra={})
        whole = gather(scan.blocks(source), flat, source.count)
    rows = {name: _joined(parts) for name, parts in scan.rows.items()}
    if limits.duplicates:
        rows[DUPLICATE.name] = np.flatnonzero(repeated(_joined(scan.keys)))
    if whole is not None:
        # what single rows show is known already, and does not count as a neighbor
        known = np.zeros(scan.count, bool)
        known[np.concatenate([np.zeros(0, np.int64), *rows.values()])] = True
        left = np.flatnonzero(~known)
        why = find_defects(
            whole[left], Limits(None, limits.giant, limits.floater, limits.needle, False)
        )
        for number, name in enumerate(REASONS):
            if name not in rows:
                rows[name] = left[why == number]
    found = [
        Found(defect, rows[defect.name])
        for defect in (*INVALID, *DEFECTS)
        if len(rows.get(defect.name, ()))
    ]
    return Report(scan.count, scan.refused, tuple(found))


class _Scan:
    """Counts of defects that single rows show, gathered block by block."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.count = self.refused = 0
        names = [defect.name for defect in INVALID]
        names += [INVISIBLE.name] if limits.invisible is not None else []
        self.rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
        self.keys: list[np.ndarray] = []

    def blocks(self, source: SceneSource) -> Iterator[SplatTable]:
        """The rows of the file without view-dependent color and other columns."""
        for block in source.blocks():
            bad = invalid_rows(block)
            self.refused += int(bad.sum())
            if bad.any():
                for name, rows in invalid(block).items():
                    self.rows[name].append(self.count + np.flatnonzero(rows))
            if self.limits.invisible is not None:
                faint = invisible(block, self.limits.invisible) & ~bad
                self.rows[INVISIBLE.name].append(self.count + np.flatnonzero(faint))
            if self.limits.duplicates:
                self.keys.append(fingerprints(block))
            self.count += len(block)
            fields = {name: getattr(block, name) for name in SPLAT_FIELDS}
            yield SplatTable(**{**fields, "sh": block.sh[:, :1]})


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


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
