"""Levels of detail: the scene, and versions of it with fewer and fewer Gaussians."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gsedit.errors import UsageError
from gsedit.files.table import SplatTable, gaussians_of, table_of
from gsedit.points.decimate import fewer, share_of
from gsedit.points.operation import Scene


def lod_tables(table: SplatTable, levels: int, share: float) -> Iterator[SplatTable]:
    """The table, then each level made from the one before, with `share` of its rows.

    Raises UsageError for fewer than 2 levels or a share outside (0, 1).
    """
    if levels < 2 or not 0 < share < 1:
        raise UsageError(
            f"{levels} levels of {100 * share:g} %: make 2 or more, each with a share of the one "
            "before between 0 and 100 %"
        )
    yield table
    for _ in range(levels - 1):
        table = fewer(table, share_of(len(table), share), "merge")
        yield table


def lod(scene: Scene, levels: int = 4, share: float = 0.5) -> list[Scene]:
    """The scene and `levels` - 1 coarser ones, each with `share` of the Gaussians of the one
    before."""
    given: Any = scene
    if isinstance(given, SplatTable):
        return list(lod_tables(given, levels, share))  # pyright: ignore[reportReturnType]
    tables = lod_tables(table_of(given), levels, share)
    return [gaussians_of(table) for table in tables]  # pyright: ignore[reportReturnType]
