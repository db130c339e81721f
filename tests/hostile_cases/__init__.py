"""The hostile and extreme inputs of tests/hostile.py, by kind: each makes files and a command."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hostile_cases.base import Case
from hostile_cases.cameras import cameras
from hostile_cases.command_lines import (
    expressions,
    flags,
    full_disks,
    headers,
    old_verbs,
    outputs,
    sentences,
    sizes,
)
from hostile_cases.datasets import colmap_folders, meshes, photo_folders
from hostile_cases.interrupted import checkpoints, edit_folders
from hostile_cases.scenes import scenes


def all_cases(given: Path) -> Iterator[Case]:
    """Make every case; what takes long to make is made once, in the folder `given`."""
    yield from scenes()
    yield from cameras()
    yield from photo_folders()
    yield from colmap_folders()
    yield from meshes()
    yield from checkpoints(given)
    yield from edit_folders(given)
    yield from expressions()
    yield from sentences()
    yield from sizes()
    yield from outputs()
    yield from flags()
    yield from headers()
    yield from old_verbs()
    yield from full_disks()
