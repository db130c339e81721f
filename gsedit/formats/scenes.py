"""Scenes of the renderer from files and back: checked number by number, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gsedit.errors import InputError, UsageError
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.registry import READABLE, WRITABLE
from gsedit.formats.streams import SceneHeader, gather, header_of, in_blocks
from gsedit.formats.validity import Guard
from gsedit.scene.table import gaussians_of, table_of
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.scene import Gaussians

__all__ = ["READABLE", "WRITABLE", "SceneFile", "load", "read_scene", "save"]


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene as it was read, with notes on its file."""

    scene: Gaussians
    header: SceneHeader
    """Header of the file, which holds for all rows."""
    notes: tuple[str, ...] = ()
    """Columns, elements and rows that were left out, one sentence each."""
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Columns of the file that are no part of a Gaussian: one value a row."""

    @property
    def numerics(self) -> Numerics:
        """How it is rendered: with Mip-Splatting's 2D filter where it was trained so."""
        return Numerics(antialiased=True) if self.header.antialiased else DEFAULT


def load(path: str | Path, *, drop_invalid: bool = False) -> Gaussians:
    """Read a scene, float32, in any format of READABLE.

    Every number is finite and every quaternion has a direction afterwards: rows that break this
    raise InputError, or are left out with `drop_invalid`. An infinite opacity counts as invalid.
    Raises UsageError for another suffix, InputError for a file that is not what it should be.
    """
    return read_scene(path, drop_invalid=drop_invalid).scene


def read_scene(path: str | Path, *, drop_invalid: bool = False) -> SceneFile:
    """`load`, with notes on everything in the file that did not become part of the scene."""
    source = open_scene(path)
    guard = Guard(drop=drop_invalid)
    table = gather(guard(source.blocks()), source.header, source.count)
    guard.check(source.path)
    if len(table) == 0:
        raise InputError(f"{path} holds no Gaussians: export it again")
    notes, header = [*source.notes], source.header
    if header.extra:
        notes.append(f"columns that are no part of a Gaussian: {', '.join(header.extra)}")
    if header.elements:
        notes.append(f"elements left out: {', '.join(header.elements)}")
    if guard.invalid:
        notes.append(f"rows left out: {guard.invalid} of {guard.rows}")
    return SceneFile(gaussians_of(table), header, tuple(notes), table.extra)


def save(scene: Gaussians, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a scene by suffix, in any format of WRITABLE: .ply is exact in float32.

    Atomic, creates parent folders. Raises UsageError if the file exists (and not `overwrite`), the
    suffix is unknown, the SH degree is above the format's, or the scene is empty or holds NaN.
    """
    guard = Guard(drop=False)
    table = table_of(scene)
    for _ in guard(in_blocks(table)):
        pass
    guard.check(Path(path), lambda text: UsageError(f"{text}; nothing was written"))
    write_scene(path, header_of(table), in_blocks(table), overwrite=overwrite)
