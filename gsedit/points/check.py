"""Every defect of a scene file with the rows that have it: also of files that `load` refuses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from gsedit.files.streams import SceneSource, gather
from gsedit.files.table import SPLAT_FIELDS, SplatTable
from gsedit.files.validity import invalid_rows
from gsedit.points.defects import (
    DUPLICATE,
    INVALID,
    INVISIBLE,
    UNWANTED,
    Defect,
    fingerprints,
    invalid,
    invisible,
    repeated,
)
from gsedit.points.survey import REASONS, USUAL, Limits, survey


@dataclass(frozen=True, eq=False)
class Found:
    """The Gaussians with one defect."""

    defect: Defect
    rows: Int64[np.ndarray, " r"]
    """In the order of the file, from 0."""


@dataclass(frozen=True, eq=False)
class Report:
    """What is wrong with a scene."""

    gaussians: int
    refused: int
    """Rows that make `load` refuse the file."""
    found: tuple[Found, ...]
    """The defects that some rows have: those of INVALID, then those of UNWANTED."""

    @property
    def defective(self) -> int:
        """Rows with any defect."""
        return len(np.unique(np.concatenate([f.rows for f in self.found]))) if self.found else 0


def check(source: SceneSource, limits: Limits = USUAL, *, quick: bool = False) -> Report:
    """Look for every defect that needs no cameras.

    `quick` leaves out those that depend on a Gaussian's neighbours; the file may then be larger
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
        # what single rows show is known already, and does not count as a neighbour
        known = np.zeros(scan.count, bool)
        known[np.concatenate([np.zeros(0, np.int64), *rows.values()])] = True
        left = np.flatnonzero(~known)
        why = survey(whole[left], Limits(None, limits.giant, limits.floater, limits.needle, False))
        for number, name in enumerate(REASONS):
            if name not in rows:
                rows[name] = left[why == number]
    found = [
        Found(defect, rows[defect.name])
        for defect in (*INVALID, *UNWANTED)
        if len(rows.get(defect.name, ()))
    ]
    return Report(scan.count, scan.refused, tuple(found))


class _Scan:
    """What single rows show, while they pass."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.count = self.refused = 0
        names = [defect.name for defect in INVALID]
        names += [INVISIBLE.name] if limits.invisible is not None else []
        self.rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
        self.keys: list[np.ndarray] = []

    def blocks(self, source: SceneSource) -> Iterator[SplatTable]:
        """The rows of the file without view-dependent colour and other columns."""
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
