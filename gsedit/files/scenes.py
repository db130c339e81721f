"""Gaussian scenes by suffix: read, checked number by number, and written whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from pathlib import Path

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.files.atomic import atomic_path
from gsedit.files.compressed_ply import is_compressed, read_compressed, write_compressed
from gsedit.files.inputs import existing_file
from gsedit.files.inria import AT_ONCE, field_columns, read_inria, write_inria
from gsedit.files.ply import read_ply_header
from gsedit.files.splat import read_splat
from gsedit.files.spz import read_spz, write_spz
from rasterizer.scene import Gaussians

READABLE = (".ply", ".compressed.ply", ".spz", ".splat")
WRITABLE = (".ply", ".compressed.ply", ".spz")
_MIN_NORM = 1e-12  # a shorter quaternion has no direction: torch's normalize gives up here too
_MAX_LOG_SCALE = 40.0  # e^40 squared still has room in float32; a scene never does


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene as it was read, with notes on its file."""

    scene: Gaussians
    notes: tuple[str, ...] = ()
    """Columns, elements and rows that were left out, one sentence each."""


def load(path: str | Path, *, drop_invalid: bool = False) -> Gaussians:
    """Read a scene, float32: .ply (INRIA), .compressed.ply, .spz, .splat.

    Every number is finite and every quaternion has a direction afterwards: rows that break this
    raise InputError, or are left out with `drop_invalid`. An infinite opacity counts as invalid.
    Raises UsageError for another suffix, InputError for a file that is not what it should be.
    """
    return read_scene(path, drop_invalid=drop_invalid).scene


def read_scene(path: str | Path, *, drop_invalid: bool = False) -> SceneFile:
    """`load`, with notes on everything in the file that did not become part of the scene."""
    path = Path(path)
    scene, notes = _read(path)
    if len(scene) == 0:
        raise InputError(f"{path} holds no Gaussians: export it again")
    bad = _invalid_rows(scene)
    if not bad.any():
        return SceneFile(scene, notes)
    if not drop_invalid:
        raise InputError(f"{path}: {_describe(scene, bad)}: --drop-invalid leaves them out")
    if bad.all():
        raise InputError(f"{path}: all {len(scene)} rows are invalid: export it again")
    return SceneFile(scene[~bad], (*notes, f"rows left out: {int(bad.sum())} of {len(scene)}"))


def save(scene: Gaussians, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a scene by suffix: .ply (INRIA, exact in float32), .compressed.ply and .spz (lossy).

    Atomic, creates parent folders. Raises UsageError if the file exists (and not `overwrite`), the
    suffix is unknown, the SH degree is above 3, or the scene is empty or holds NaN.
    """
    path = Path(path)
    write = {".ply": write_inria, ".compressed.ply": write_compressed, ".spz": write_spz}
    suffix = _suffix(path)
    if suffix not in WRITABLE:
        raise UsageError(f"{path}: gsedit writes {', '.join(WRITABLE)}: choose one of these")
    scene = scene.detach().to(torch.float32).map(Tensor.cpu)
    if len(scene) == 0:
        raise UsageError(f"{path} would hold no Gaussians: nothing was written, keep at least one")
    bad = _invalid_rows(scene)
    if bad.any():
        raise UsageError(
            f"{path}: {_describe(scene, bad)}: nothing was written, remove these rows first"
        )
    with atomic_path(path, overwrite=overwrite) as temporary:
        write[suffix](scene, temporary)


def _suffix(path: Path) -> str:
    name = path.name.lower()
    return ".compressed.ply" if name.endswith(".compressed.ply") else Path(name).suffix


def _read(path: Path) -> tuple[Gaussians, tuple[str, ...]]:
    existing_file(path)  # before the suffix: that the file is missing is the more useful message
    match _suffix(path):
        case ".ply" | ".compressed.ply":
            header = read_ply_header(path)
            if is_compressed(header):  # by content: exporters often leave ".compressed" out
                return read_compressed(path), ()
            return read_inria(path, header)
        case ".spz":
            return read_spz(path), ()
        case ".splat":
            return read_splat(path), ()
    raise UsageError(f"{path}: gsedit reads {', '.join(READABLE)}: name one of these")


def _invalid_rows(scene: Gaussians) -> Bool[Tensor, " n"]:
    parts = [torch.zeros(0, dtype=torch.bool)]
    for start in range(0, len(scene), AT_ONCE):  # a test of all rows at once would be a copy
        part = scene[start : start + AT_ONCE]
        bad = part.quats.norm(dim=1) < _MIN_NORM
        bad |= (part.log_scales > _MAX_LOG_SCALE).any(1)
        for field in fields(part):
            bad |= ~getattr(part, field.name).isfinite().reshape(len(part), -1).all(1)
        parts.append(bad)
    return torch.cat(parts)


def _describe(scene: Gaussians, bad: Bool[Tensor, " n"]) -> str:
    """The first invalid number, where it is, and how many rows are like it."""
    row = int(bad.nonzero()[0])
    numbers = (
        (name, value)
        for field, names in field_columns(scene.sh.shape[1]).items()
        for name, value in zip(names.ravel(), getattr(scene, field)[row].flatten().tolist())
    )
    broken = next(
        (f"column {name} is {value}" for name, value in numbers if not isfinite(value)), ""
    )
    if not broken and float(scene.log_scales[row].max()) > _MAX_LOG_SCALE:
        broken = f"a scale is exp({float(scene.log_scales[row].max()):g}), beyond any scene"
    place = broken or "its quaternion rot_0..rot_3 is zero"
    return f"row {row} (from 0): {place}; {int(bad.sum())} of {len(scene)} rows are invalid"
