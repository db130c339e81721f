"""antimatter15's .splat: rows of 32 bytes, no header, no SH, linear scales and opacities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsedit.errors import InputError
from gsedit.formats.quantised import bytes_of, log_scales_of, logits_of
from gsedit.formats.streams import AT_ONCE, Blocks, ReadOptions, SceneHeader, SceneSource
from gsedit.scene.table import SplatTable
from rasterizer.numerics import color_to_sh

ROW = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .splat. Raises InputError for one that was cut off."""
    count, rest = divmod(path.stat().st_size, ROW.itemsize)
    if rest:
        raise InputError(
            f"{path} is no whole number of {ROW.itemsize}-byte rows: "
            "it is cut off, copy or export it again"
        )
    return SceneSource(path, ".splat", SceneHeader(0), count, lambda: _read(path, count))


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write the rows in their order; the number of rows. Viewers sort by depth themselves; those
    that draw while they load show first what comes first."""
    count = 0
    with path.open("wb") as handle:
        for block in blocks:
            _pack(block).tofile(handle)
            count += len(block)
    return count


def _pack(table: SplatTable) -> np.ndarray:
    rows = np.empty(len(table), ROW)
    rows["means"], rows["scales"] = table.means, table.scales
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # damaged rows: told later
        rows["rgba"][:, :3] = bytes_of(table.colors)
        rows["rgba"][:, 3] = bytes_of(table.opacities)
        quats = table.quats / np.linalg.norm(table.quats, axis=1, keepdims=True)
        rows["quats"] = (quats * 128 + 128.5).clip(0, 255)
    return rows


def _read(path: Path, count: int) -> Blocks:
    with path.open("rb") as handle:
        for start in range(0, count, AT_ONCE):
            rows = np.frombuffer(handle.read(AT_ONCE * ROW.itemsize), ROW)
            if not len(rows):
                raise InputError(f"{path} ends after row {start} of {count}: copy it again")
            yield _unpack(rows)


def _unpack(rows: np.ndarray) -> SplatTable:
    rgba = rows["rgba"].astype(np.float32) / 255
    quats = (rows["quats"].astype(np.float32) - 128) / 128
    log_scales, logits = log_scales_of(rows["scales"]), logits_of(rgba[:, 3])
    return SplatTable(
        rows["means"].copy(), quats, log_scales, logits, color_to_sh(rgba[:, None, :3])
    )
