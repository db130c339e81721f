"""Networks' graphs in OpenVINO's format, kept in the user's cache folder.

A graph is a folder `<key>` with graph.xml, graph.bin (the weights) and whole.json, which has the
sizes and checksums of both: a graph is read if they are right. Folders are renamed when they are
whole, and the longest unused ones go where all together are larger than `MOST_BYTES`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

import torch
from torch import Tensor

from rasterizer.compiled import cache_folder

MOST_BYTES = 24_000_000_000
"""Largest cache: two networks of 2.6 billion weights (SDXL) in float32."""
LEAST_FREE = 2.0
"""Free bytes of the disk for each byte to be written: a cache must not fill a disk."""
NAMES = ("graph.xml", "graph.bin")
WHOLE = "whole.json"
CHUNK = 1 << 24  # bytes


def graphs_folder() -> Path:
    """`openvino` in gsedit's cache folder. Raises OSError where there is no such place."""
    return cache_folder() / "openvino"


def cached_bytes() -> int:
    """Size of all graphs in the cache; 0 where there is none."""
    with suppress(OSError):
        return sum(_size(each) for each in _graphs(graphs_folder()))
    return 0


def weights_digest(tensors: Iterable[tuple[str, Tensor]]) -> str:
    """A hash of every byte of named tensors, with their dtypes and shapes.

    Files' names and times would be less: the same weights may lie anywhere, in any layout.
    """
    digest = hashlib.sha1(usedforsecurity=False)  # the fastest here: 1.5 GB/s
    for name, tensor in tensors:
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.detach().contiguous().view(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def find(key: str) -> Path | None:
    """The graph.xml of a whole graph; None where there is none. A damaged one is removed."""
    try:
        folder = graphs_folder() / key
        record = json.loads((folder / WHOLE).read_text())
    except (OSError, ValueError):
        return None
    sums = {name: _checksum(folder / name) for name in NAMES}
    if record == sums and None not in sums.values():
        with suppress(OSError):
            os.utime(folder / WHOLE)  # used now
        return folder / NAMES[0]
    shutil.rmtree(folder, ignore_errors=True)
    return None


def keep(key: str, size: int, write: Callable[[Path], None]) -> Path | None:
    """Write a graph of about `size` bytes (`write` is given the path of graph.xml).

    Returns its place; None where it does not fit, or cannot be written: then nothing is kept.
    """
    try:
        folder = graphs_folder()
        folder.mkdir(mode=0o700, exist_ok=True)
        _make_room(folder, size)
        if size > MOST_BYTES or LEAST_FREE * size > shutil.disk_usage(folder).free:
            return None
        begun = Path(tempfile.mkdtemp(prefix=".begun-", dir=folder))
    except OSError:
        return None
    try:
        write(begun / NAMES[0])
        record = {name: _checksum(begun / name) for name in NAMES}
        (begun / WHOLE).write_text(json.dumps(record))
        shutil.rmtree(folder / key, ignore_errors=True)
        begun.rename(folder / key)
        return folder / key / NAMES[0]
    except (OSError, RuntimeError):  # OpenVINO raises RuntimeError for a full disk
        return None
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _make_room(folder: Path, size: int) -> None:
    """Remove the longest unused graphs until `size` more bytes fit, and what was cut off."""
    graphs = sorted(_graphs(folder), key=_last_used)
    total = sum(map(_size, graphs)) + size
    for graph in graphs:
        if total <= MOST_BYTES and _last_used(graph):
            break
        total -= _size(graph)
        shutil.rmtree(graph, ignore_errors=True)


def _graphs(folder: Path) -> list[Path]:
    return [each for each in folder.iterdir() if each.is_dir()] if folder.is_dir() else []


def _last_used(graph: Path) -> float:
    """Seconds since the epoch; 0 for one whose writing did not end. One may just be written."""
    try:
        return (graph / WHOLE).stat().st_mtime
    except OSError:
        is_new = graph.name.startswith(".begun-")
        return graph.stat().st_mtime if is_new and graph.exists() else 0.0


def _size(graph: Path) -> int:
    with suppress(OSError):
        return sum(file.stat().st_size for file in graph.iterdir())
    return 0


def _checksum(path: Path) -> list[int] | None:
    """[size, CRC-32] of a file; None where it cannot be read."""
    total = crc = 0
    try:
        with path.open("rb") as file:
            while chunk := file.read(CHUNK):
                crc, total = zlib.crc32(chunk, crc), total + len(chunk)
    except OSError:
        return None
    return [total, crc]
