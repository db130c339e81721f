"""Subjects and segments of scenes, kept in the cache folder: to find them takes seconds.

A record is of the scene's numbers, of the cameras, and of the program that looks: it is found anew
where any of them is another.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from pickle import UnpicklingError
from typing import TypeVar

import torch

from gsedit.errors import GseditError
from gsedit.runs.state import digest_of
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments
from gsedit.storage.atomic import atomic_path
from rasterizer.camera import Camera
from rasterizer.compiled import cache_folder
from rasterizer.scene import Gaussians

Found = TypeVar("Found", Region, Segments)
FOLDER = "looks"
LEAST = 20_000
"""Gaussians of a scene from which looking takes a second."""
MOST_FILES = 200
"""Records that are kept, the latest used: about 0.2 MB each for 150,000 Gaussians."""
torch.serialization.add_safe_globals([Region, Segment, Segments])  # what a record may hold


def remembered(
    name: str, scene: Gaussians, cameras: Sequence[Camera], find: Callable[[], Found]
) -> Found:
    """What was found by this name in the scene, or what `find` finds now."""
    file = None if len(scene) < LEAST else _file(name, scene, cameras)
    if file is None:
        return find()
    with suppress(OSError, EOFError, RuntimeError, ValueError, UnpicklingError, zlib.error):
        found = torch.load(BytesIO(gzip.decompress(file.read_bytes())), weights_only=True)
        file.touch()
        return found
    found, record = find(), BytesIO()
    torch.save(found, record)
    with suppress(OSError, GseditError):  # a full disk: it is found again the next time
        with atomic_path(file, overwrite=True) as temporary:
            temporary.write_bytes(gzip.compress(record.getvalue(), 1))
        every = sorted(file.parent.glob("*.gz"), key=lambda each: each.stat().st_mtime)
        for each in every[:-MOST_FILES]:
            each.unlink(missing_ok=True)
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
    return folder / f"{digest_of(getattr(scene, each.name) for each in fields(scene))}-{asked}.gz"


@lru_cache(maxsize=1)
def _program() -> str:
    """A digest of the files of this room: another program may find something else."""
    total = sha256()
    for each in sorted(Path(__file__).parent.iterdir()):
        if each.is_file():
            total.update(each.read_bytes())
    return total.hexdigest()
