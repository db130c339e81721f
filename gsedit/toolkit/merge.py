"""Several scenes as one: the rows of the first, then those of the others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.formats.streams import PROGRAM, Blocks, SceneHeader, SceneSource, header_of, in_blocks
from gsedit.formats.validity import Guard
from gsedit.scene.table import SplatTable, table_of
from gsedit.toolkit.operation import Operation, Say, Scene, apply


@dataclass(frozen=True, eq=False)
class Merge(Operation):
    """Add the rows of other scenes, a part at a time.

    SH get the highest degree of all (new bands are 0). A column that a scene lacks is filled with
    NaN, or 0 if it holds whole numbers. Comments and other elements are the first scene's. Raises
    InputError for invalid rows of the others.
    """

    others: tuple[SceneSource, ...]
    drop_invalid: bool = False
    """Whether invalid rows of the others are left out instead of refused."""

    def header(self, header: SceneHeader) -> SceneHeader:
        headers = [header, *(other.header for other in self.others)]
        extra: dict[str, np.dtype] = {}
        for each in headers:
            for name, kind in each.extra.items():
                extra[name] = np.promote_types(extra.get(name, kind), kind)
        return header.replace(degree=max(each.degree for each in headers), extra=extra)

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        whole = self.header(header)
        for note in self._notes(header, whole):
            say(note)
        for block in blocks:
            yield filled(block, whole)
        for other in self.others:
            guard = Guard(drop=self.drop_invalid)
            for block in guard(other.blocks()):
                yield filled(block, whole)
            guard.check(other.path)
            if guard.invalid:
                say(f"{other.path}: invalid rows left out: {guard.invalid:,}")

    def _notes(self, header: SceneHeader, whole: SceneHeader) -> Iterable[str]:
        """Report how the scenes differ, and what becomes of each difference."""
        headers = {"the first scene": header, **{str(o.path): o.header for o in self.others}}
        for name, each in headers.items():
            if each.degree < whole.degree:
                yield f"{name}: SH of degree {each.degree} became degree {whole.degree}, with zeros"
            missing = [column for column in whole.extra if column not in each.extra]
            if missing:
                yield f"{name} lacks columns, which are NaN or 0 for it: {', '.join(missing)}"
        for other in self.others:
            for note in other.notes:
                yield f"{other.path}: {note}"
            comments = [c for c in other.header.comments if not c.startswith(PROGRAM)]
            if comments and comments != [*header.comments]:
                yield f"{other.path}: comments left out: {'; '.join(comments)}"
            if other.header.antialiased != header.antialiased:
                yield f"{other.path} differs from the first scene in antialiasing: its is not kept"
            if other.header.elements:
                names = ", ".join(other.header.elements)
                yield f"{other.path}: elements left out: {names}"


def filled(table: SplatTable, header: SceneHeader) -> SplatTable:
    """The rows with SH of the header's degree and with all of its columns."""
    sh, n = table.sh, len(table)
    if table.degree < header.degree:
        sh = np.zeros((n, (header.degree + 1) ** 2, 3), np.float32)
        sh[:, : table.sh.shape[1]] = table.sh
    extra = {}
    for name, kind in header.extra.items():
        empty = np.nan if np.issubdtype(kind, np.floating) else 0
        extra[name] = table.extra[name].astype(kind) if name in table.extra else None
        if extra[name] is None:
            extra[name] = np.full(n, empty, kind)
    return table.replace(sh=sh, extra=extra)


def merge(scene: Scene, *others: Scene) -> Scene:
    """The rows of all scenes in one, in order; all of one kind."""
    return apply(scene, Merge(tuple(_source(i, each) for i, each in enumerate(others))))


def _source(index: int, scene: Any) -> SceneSource:
    table = scene if isinstance(scene, SplatTable) else table_of(scene)
    path = Path(f"scene {index + 2}")
    return SceneSource(path, "in memory", header_of(table), len(table), partial(in_blocks, table))
