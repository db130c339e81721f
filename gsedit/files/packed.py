"""Quantised scenes, a few bytes a Gaussian: PlayCanvas .compressed.ply, Niantic .spz, .splat.

Readers raise InputError for a damaged file, writers UsageError for a scene that does not fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsedit.errors import InputError, UsageError
from gsedit.files.inria import from_gsply
from gsedit.files.ply import PlyHeader
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

LOGIT_MAX = 15.0
"""These formats store opacity in 8 bits, and 255 means 1, whose logit is infinite. The sigmoid of
15 is 1 - 3e-7: about the largest logit at which float32 still has a gradient."""
_SPZ_LIMIT = (1 << 23) - 1  # positions are 24-bit signed fixed point
_SPLAT_ROW = np.dtype(
    [("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)]
)


def is_compressed(header: PlyHeader) -> bool:
    """Whether this PLY has PlayCanvas' packed layout, whatever the file's name."""
    vertex = header.element("vertex")
    return vertex is not None and "packed_position" in vertex.names


def read_compressed(path: Path) -> Gaussians:
    """Read a .compressed.ply through gsply, after its header and size were checked."""
    import gsply

    return _decoded(path, lambda: gsply.plyread(path))


def read_spz(path: Path) -> Gaussians:
    """Read an .spz through gsply: versions 1-3, and 4 where the package zstandard is installed.

    Coordinates are taken as stored: the specification has RUB axes, but not all writers do.
    """
    import gsply

    return _decoded(path, lambda: gsply.read_spz(path))


def read_splat(path: Path) -> Gaussians:
    """antimatter15's .splat: rows of 32 bytes, no header, no SH, linear scales and opacities."""
    if path.stat().st_size % _SPLAT_ROW.itemsize:
        raise InputError(
            f"{path} is no whole number of {_SPLAT_ROW.itemsize}-byte rows: "
            "it is cut off, copy or export it again"
        )
    rows = np.fromfile(path, _SPLAT_ROW)
    scales = torch.from_numpy(rows["scales"].copy())
    rgba = torch.from_numpy(rows["rgba"]).float() / 255
    quats = (torch.from_numpy(rows["quats"]).float() - 128) / 128
    # exporters round tiny scales to 0: the smallest normal float keeps the logarithm finite
    log_scales = torch.where(scales == 0, torch.finfo().tiny, scales).log()
    means = torch.from_numpy(rows["means"].copy())
    sh = (rgba[:, None, :3] - 0.5) / SH_DC
    return _clamped(Gaussians(means, quats, log_scales, rgba[:, 3].logit(), sh))


def write_compressed(scene: Gaussians, path: Path) -> None:
    """PlayCanvas' layout through gsply: 16 bytes a Gaussian and one a SH coefficient."""
    import gsply

    gsply.plywrite(path, _to_gsply(scene, path), compressed=True)


def write_spz(scene: Gaussians, path: Path) -> None:
    """SPZ version 3 through gsply, positions as fine as the scene's extent allows."""
    import gsply

    extent = max(float(scene.means.abs().max()), 1e-6)
    bits = min(12, int(np.floor(np.log2(_SPZ_LIMIT / extent))))  # 12: Niantic's default
    if bits < 1:
        raise UsageError(f"{path}: .spz holds positions up to 4e6, not {extent:.3g}: save a .ply")
    gsply.write_spz(path, _to_gsply(scene, path), fractional_bits=bits)


def _decoded(path: Path, read: Callable[[], Any]) -> Gaussians:
    try:
        return _clamped(from_gsply(read()))
    except (ValueError, MemoryError, OverflowError, KeyError, IndexError) as error:
        reason = str(error).split("\n")[0].removesuffix(f": {path}")
        if "zstandard" in reason:
            move = "run `pip install zstandard`, or save it as SPZ version 3"
            raise InputError(f"{path} is SPZ version 4: {move}") from None
        raise InputError(f"{path} cannot be unpacked ({reason}): export it again") from None


def _clamped(scene: Gaussians) -> Gaussians:
    return replace(scene, logit_opacities=scene.logit_opacities.clamp(-LOGIT_MAX, LOGIT_MAX))


def _to_gsply(scene: Gaussians, path: Path) -> Any:
    from gsply import GSData

    if scene.degree > 3:
        raise UsageError(f"{path}: SH degree {scene.degree} does not fit: reduce it to 3 first")
    quats = torch.nn.functional.normalize(scene.quats, dim=1)  # smallest-three packing needs it
    fields = (scene.means, scene.log_scales, quats, scene.logit_opacities)
    dc, rest = scene.sh[:, 0].contiguous(), scene.sh[:, 1:].contiguous()
    return GSData.from_arrays(*(f.numpy() for f in (*fields, dc, rest)), format="ply")
