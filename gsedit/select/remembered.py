"""Subjects and segments of scenes, kept in the cache folder: to find them takes seconds.

A record is of the scene's numbers, of the cameras, and of the program that looks: it is found anew
where any of them is another.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, fields, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
import torch

from gsedit.errors import GseditError
from gsedit.runs.state import digest_of
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments
from gsedit.storage.atomic import atomic_path
from rasterizer.camera import Camera
from rasterizer.compiled import cache_folder
from rasterizer.scene import Gaussians

T = TypeVar("T")
Arrays = dict[str, np.ndarray]
FOLDER = "looks"
LEAST = 20_000
"""Gaussians of a scene from which looking takes a second."""
MOST_FILES = 200
"""Records that are kept, the latest used: about 0.2 MB each for 150,000 Gaussians."""


def remembered_region(
    name: str, scene: Gaussians, cameras: Sequence[Camera], find: Callable[[], Region]
) -> Region:
    """The region that was found by this name in the scene, or that `find` finds now."""
    return _remembered(name, scene, cameras, find, _of_region, _to_region)


def remembered_segments(
    scene: Gaussians, cameras: Sequence[Camera], find: Callable[[], Segments]
) -> Segments:
    """The segments that were found in the scene, or that `find` finds now."""
    return _remembered("segments", scene, cameras, find, _of_segments, _to_segments)


def _remembered(
    name: str,
    scene: Gaussians,
    cameras: Sequence[Camera],
    find: Callable[[], T],
    pack: Callable[[T], Arrays],
    unpack: Callable[[Arrays, int], T],
) -> T:
    if len(scene) < LEAST:
        return find()
    file = _file(name, scene, cameras)
    if file is not None:
        with suppress(OSError, ValueError, KeyError, TypeError, BadZipFile):
            with np.load(file, allow_pickle=False) as arrays:
                found = unpack(dict(arrays), len(scene))
            file.touch()
            return found
    found = find()
    if file is not None:
        with suppress(OSError, GseditError):  # a full disk: it is found again the next time
            _write(file, pack(found))
    return found


def _file(name: str, scene: Gaussians, cameras: Sequence[Camera]) -> Path | None:
    """The file of a record; None where there is no folder to keep one in."""
    try:
        folder = cache_folder() / FOLDER
        folder.mkdir(exist_ok=True)
    except (OSError, GseditError):
        return None
    views = [replace(each, world_to_camera=torch.eye(4)) for each in cameras]
    poses = digest_of(each.world_to_camera for each in cameras)
    asked = sha256(f"{name} {_program()} {views} {poses}".encode()).hexdigest()[:16]
    return folder / f"{digest_of(getattr(scene, each.name) for each in fields(scene))}-{asked}.npz"


@lru_cache(maxsize=1)
def _program() -> str:
    """A digest of the files of this room: another program may find something else."""
    total = sha256()
    for each in sorted(Path(__file__).parent.iterdir()):
        if each.is_file():
            total.update(each.read_bytes())
    return total.hexdigest()


def _write(file: Path, arrays: Arrays) -> None:
    with atomic_path(file, overwrite=True) as temporary, temporary.open("wb") as handle:
        np.savez_compressed(handle, allow_pickle=False, **arrays)
    every = sorted(file.parent.glob("*.npz"), key=lambda each: each.stat().st_mtime)
    for each in every[:-MOST_FILES]:
        each.unlink(missing_ok=True)


def _of_region(region: Region) -> Arrays:
    told = json.dumps([region.note, region.sure])
    return {"inside": np.packbits(region.inside.numpy()), "told": np.array(told)}


def _to_region(arrays: Arrays, count: int) -> Region:
    note, sure = json.loads(str(arrays["told"]))
    inside = np.unpackbits(arrays["inside"], count=count).astype(bool)
    return Region(torch.from_numpy(inside), note, sure=sure)


def _of_segments(segments: Segments) -> Arrays:
    rows = json.dumps([asdict(row) for row in segments.rows])
    labels = segments.labels.numpy().astype(np.int32)
    return {"labels": labels, "rows": np.array(rows), "view": np.array(segments.view)}


def _to_segments(arrays: Arrays, count: int) -> Segments:
    rows = tuple(Segment(**_tuples(row)) for row in json.loads(str(arrays["rows"])))
    labels = torch.from_numpy(arrays["labels"].astype(np.int64))
    if len(labels) != count:
        raise ValueError("a record of another scene")
    return Segments(labels, rows, int(arrays["view"]))


def _tuples(value: Any) -> Any:
    """A value of JSON with tuples in the place of lists."""
    if isinstance(value, dict):
        return {key: _tuples(each) for key, each in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
