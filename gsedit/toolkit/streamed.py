"""Streamed SOG, written: levels of detail of one scene, in folders of bounded size, for viewers.

The finest level is halved at the median of its longest side until a leaf has few rows; coarser
levels are divided by the same planes, so that a viewer may show each leaf in any level.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int

from gsedit.formats.sog.encode import store_sog
from gsedit.formats.sog.pictures import META
from gsedit.formats.sog.streamed import INDEX
from gsedit.scene.morton import morton_order
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SplatTable
from gsedit.storage.atomic import atomic_path

LEAF_ROWS = 1 << 15
"""Rows of a leaf at most, unless they are at one place: a viewer chooses a level for each leaf."""
CHUNK_ROWS = 1 << 18
"""Rows of a folder at most: a viewer loads it whole, 3 to 6 MB."""


@dataclass(eq=False)
class _Node:
    """A box of the tree: with a plane and two halves, or a leaf."""

    axis: int = 0
    plane: float = 0.0
    halves: tuple[_Node, _Node] | None = None
    low: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.full(3, np.inf))
    high: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.full(3, -np.inf))
    runs: dict[str, dict[str, int]] = field(default_factory=dict)

    def record(self) -> dict[str, Any]:
        """For lod-meta.json; numbers of seven digits, as its specification says."""
        if self.halves is None:
            own: dict[str, Any] = {"lods": self.runs}
        else:
            own = {"children": [half.record() for half in self.halves]}
            self.low = np.minimum(*(half.low for half in self.halves))
            self.high = np.maximum(*(half.high for half in self.halves))
        ends = {"min": self.low, "max": self.high}
        return {"bound": {k: [float(f"{x:.7g}") for x in v] for k, v in ends.items()}, **own}


def write_streamed(
    folder: Path, levels: Iterable[SplatTable], *, antialiased: bool, overwrite: bool = False
) -> list[int]:
    """Write lod-meta.json and a folder for each chunk of each level; the rows of each level.

    Levels come finest first, each not empty, of SH degree 3 at most; they are taken one by one.
    The index is written last. Raises UsageError where files exist (and not `overwrite`).
    """
    tree, names, counts = _Node(), [], []
    for level, table in enumerate(levels):
        if level == 0:
            tree = _tree(table.means.astype(np.float64))
        counts.append(len(table))
        for chunk, leaves in enumerate(_chunks(tree, table)):
            name = f"{level}_{chunk}"
            rows = np.concatenate([rows for _, rows in leaves])
            _write_chunk(folder / name, table[rows], antialiased, overwrite)
            _note(leaves, table, str(level), len(names))
            names.append(f"{name}/{META}")
    record = {
        "version": 1,
        "asset": {"generator": "gsedit"},
        "count": sum(counts),
        "counts": counts,
        "lodLevels": len(counts),
        "filenames": names,
        "tree": tree.record(),
    }
    with atomic_path(folder / INDEX, overwrite=overwrite) as temporary:
        temporary.write_text(json.dumps(record, separators=(",", ":")))
    return counts


def _tree(means: Float64[np.ndarray, "n 3"]) -> _Node:
    sides = np.ptp(means, axis=0) if len(means) > LEAF_ROWS else np.zeros(3)
    axis = int(sides.argmax())
    plane = float(np.median(means[:, axis])) if sides[axis] > 0 else 0.0
    below = means[:, axis] < plane
    if not below.any() or below.all():
        return _Node()
    return _Node(axis, plane, (_tree(means[below]), _tree(means[~below])))


def _leaves(
    node: _Node, means: np.ndarray, rows: Int[np.ndarray, " m"]
) -> Iterator[tuple[_Node, Int[np.ndarray, " m"]]]:
    """The leaves with the rows inside, in the tree's order; rows in Morton order."""
    if node.halves is None:
        if len(rows):
            yield node, rows[morton_order(means[rows])]
        return
    below = means[rows, node.axis] < node.plane
    yield from _leaves(node.halves[0], means, rows[below])
    yield from _leaves(node.halves[1], means, rows[~below])


def _chunks(tree: _Node, table: SplatTable) -> Iterator[list[tuple[_Node, np.ndarray]]]:
    """Neighboring leaves together, as many as a folder may hold."""
    chunk, size = [], 0
    for node, rows in _leaves(tree, table.means, np.arange(len(table))):
        if chunk and size + len(rows) > CHUNK_ROWS:
            yield chunk
            chunk, size = [], 0
        chunk.append((node, rows))
        size += len(rows)
    if chunk:
        yield chunk


def _note(leaves: list[tuple[_Node, np.ndarray]], table: SplatTable, level: str, file: int) -> None:
    """Tell the leaves where their rows of a level are, and how far these reach."""
    at = 0
    for node, rows in leaves:
        part = table[rows]
        axes = rotations(part.quats.astype(np.float64)) * part.scales[:, None].astype(np.float64)
        reach = np.sqrt(np.square(axes).sum(2))  # one standard deviation, as splat-transform has
        node.low = np.minimum(node.low, (part.means - reach).min(0))
        node.high = np.maximum(node.high, (part.means + reach).max(0))
        node.runs[level] = {"file": file, "offset": at, "count": len(rows)}
        at += len(rows)


def _write_chunk(folder: Path, table: SplatTable, antialiased: bool, overwrite: bool) -> None:
    def store(name: str, data: bytes) -> None:
        with atomic_path(folder / name, overwrite=overwrite) as temporary:
            temporary.write_bytes(data)

    store_sog(store, table, antialiased=antialiased)
