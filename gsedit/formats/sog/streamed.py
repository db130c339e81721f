"""PlayCanvas' streamed SOG, read: lod-meta.json, and the folders of SOG scenes that it names.

A tree of boxes says at each leaf which rows of which folder show it in each level of detail. The
finest level is read, and the environment, which all levels share; a folder at a time.
Source: developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog, version 1.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import InputError
from gsedit.formats.sog import file as sog
from gsedit.formats.sog.pictures import META
from gsedit.formats.streams import Blocks, ReadOptions, SceneHeader, SceneSource
from gsedit.scene.table import SplatTable
from gsedit.storage.inputs import existing_file, file_inside, refuse_doubles
from gsedit.storage.json_files import checked, list_of, number, object_of, read_json, text
from gsedit.storage.safe_names import safe_name

INDEX = "lod-meta.json"
INDEX_MAX_BYTES = 16 << 20
"""Size of an index: 100,000 leaves of four levels."""
_AGAIN = "export it again"
_PLACE = number(0, 1 << 32, whole=True)
_RUN = object_of({"file": _PLACE, "count": _PLACE}, {"offset": _PLACE})


@dataclass(frozen=True)
class _Part:
    """Rows of one folder that are read."""

    source: SceneSource
    runs: tuple[tuple[int, int], ...]
    """First row and number of rows, ascending, apart from one another."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a lod-meta.json. Raises InputError for one that cannot be right, or whose folders
    are elsewhere or damaged."""
    if existing_file(path).stat().st_size > INDEX_MAX_BYTES:
        raise InputError(f"{path} has more than {INDEX_MAX_BYTES >> 20} MB of JSON: {_AGAIN}")
    meta = read_json(
        path,
        object_of({"filenames": list_of(text()), "tree": object_of({})}, {"environment": text()}),
        advice=_AGAIN,
    )
    if meta.get("version", 1) != 1:
        raise InputError(
            f"{path} is streamed SOG version {str(meta['version'])[:20]}: gsedit reads 1"
        )
    levels = _levels(path, meta["tree"])
    if not levels:
        raise InputError(f"{path} has no leaf with Gaussians: {_AGAIN}")
    finest, names = min(levels), meta["filenames"]
    parts = _parts(path, names, levels[finest], options)
    notes = []
    if len(levels) > 1:
        notes.append(f"level {finest} of detail was read, {len(levels) - 1} coarser left out")
    if "environment" in meta:
        source = _opened(path, meta["environment"], options)
        parts.append(_Part(source, ((0, source.count),)))
        notes.append(f"the environment was read too: {source.count} Gaussians")
    headers = [part.source.header for part in parts]
    header = SceneHeader(
        max(each.degree for each in headers), antialiased=any(each.antialiased for each in headers)
    )
    count = sum(rows for part in parts for _, rows in part.runs)
    return SceneSource(
        path, "streamed SOG", header, count, partial(_blocks, parts, header), tuple(notes)
    )


def _levels(path: Path, tree: dict[str, Any]) -> Mapping[int, list[dict[str, int]]]:
    """The runs of rows of each level, over all leaves."""
    found: dict[int, list[dict[str, int]]] = defaultdict(list)
    stack = [tree]
    while stack:
        node = stack.pop()
        children, lods = node.get("children") or [], node.get("lods") or {}
        if not (isinstance(children, list) and isinstance(lods, dict)):
            raise InputError(f"{path}: a node is neither inner nor leaf: {_AGAIN}")
        for child in children:
            if not isinstance(child, dict):
                raise InputError(f"{path}: a child is no node: {_AGAIN}")
            stack.append(child)
        for level, run in lods.items():
            if not level.isascii() or not level.isdigit() or len(level) > 3:
                raise InputError(f"{path}: a level is named {level[:20]!r}: {_AGAIN}")
            run = _run(path, run)
            if run["count"]:
                found[int(level)].append(run)
    return found


def _run(path: Path, run: Any) -> dict[str, int]:
    """A run with whole numbers `file`, `offset` and `count`. Raises InputError."""
    return {"offset": 0, **checked(run, _RUN, f"{path}: a leaf", advice=_AGAIN)}


def _parts(
    path: Path, names: list[str], runs: list[dict[str, int]], options: ReadOptions
) -> list[_Part]:
    """The folders that the runs name, each with its runs in order."""
    by_file: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for run in runs:
        by_file[run["file"]].append((run["offset"], run["count"]))
    if max(by_file) >= len(names):
        raise InputError(f"{path}: a leaf is in file {max(by_file)} of {len(names)}: {_AGAIN}")
    used = {file: safe_name(names[file], str(path)) for file in sorted(by_file)}
    refuse_doubles(used.values(), f"{path}: two files")
    parts = []
    for file, name in used.items():
        source, ordered = _opened(path, name, options), sorted(by_file[file])
        ends = [0, *(start + rows for start, rows in ordered)]
        if any(start < end for (start, _), end in zip(ordered, ends)) or ends[-1] > source.count:
            raise InputError(
                f"{path}: its leaves overlap in {name}, or want more than its {source.count} "
                f"rows: {_AGAIN}"
            )
        parts.append(_Part(source, tuple(ordered)))
    return parts


def _opened(path: Path, name: str, options: ReadOptions) -> SceneSource:
    """The SOG scene of that name. Raises InputError where it is missing, elsewhere, or none."""
    name = safe_name(name, str(path))
    if not name.endswith((META, ".sog")) or name.endswith(INDEX):
        raise InputError(f"{path} names {name[:80]!r}, which is no {META} of a SOG: {_AGAIN}")
    try:
        return sog.open_source(existing_file(file_inside(path.parent, name, str(path))), options)
    except InputError as error:
        raise InputError(f"{path} names a scene: {error}") from None


def _blocks(parts: list[_Part], header: SceneHeader) -> Blocks:
    for part in parts:
        at, k = 0, (header.degree + 1) ** 2
        starts = np.array([start for start, _ in part.runs])
        ends = np.array([start + rows for start, rows in part.runs])
        for block in part.source.blocks():
            rows = np.arange(at, at + len(block))
            run = np.searchsorted(starts, rows, "right") - 1
            inside = (run >= 0) & (rows < ends[run])
            at += len(block)
            if inside.any():
                yield _padded(block if inside.all() else block[inside], k)


def _padded(table: SplatTable, k: int) -> SplatTable:
    """The table with k SH coefficients, zeros behind its own."""
    if table.sh.shape[1] == k:
        return table
    sh = np.zeros((len(table), k, 3), np.float32)
    sh[:, : table.sh.shape[1]] = table.sh
    return table.replace(sh=sh)
