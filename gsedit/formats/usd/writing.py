"""OpenUSD's splats as text: a .usda with one definition, its lists one after the other.

Each list is written into a file of its own until all rows are known.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float32

from gsedit.formats.axes import to_axes
from gsedit.formats.streams import PROGRAM, Blocks, SceneHeader
from gsedit.formats.usd.numbers import write_rows
from gsedit.formats.usd.stage import COEFFICIENTS, DEGREE, SCHEMA
from gsedit.formats.usd.units import Units, units_in
from gsedit.scene.table import SplatTable

_REACH = 3
"""Standard deviations that the extent holds: 99.7 % of a Gaussian along an axis, as the schema's
kernel is described."""
_KINDS = {
    "positions": "point3f[]", "orientations": "quatf[]", "scales": "float3[]",
    "opacities": "float[]", COEFFICIENTS: "float3[]",
}  # fmt: skip


def write_text(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write the rows as one definition; their number. Axes and unit are those of the comments."""
    units, comments = units_in(header.comments)
    bounds = np.array([[np.inf] * 3, [-np.inf] * 3], np.float32)
    count = 0
    with ExitStack() as stack:
        files: dict[str, IO[bytes]] = {}
        for block in blocks:
            table = to_axes(block, units.axes)
            for name, values in _attributes(table).items():
                if name not in files:
                    files[name] = stack.enter_context(tempfile.TemporaryFile(dir=path.parent))
                write_rows(values, files[name])
            reach = _REACH * table.scales.max(1, keepdims=True)
            bounds[0] = np.fmin(bounds[0], np.fmin.reduce(table.means - reach))
            bounds[1] = np.fmax(bounds[1], np.fmax.reduce(table.means + reach))
            count += len(block)
        if count:
            about = _about(units, comments, antialiased=header.antialiased)
            _assemble(path, about, files, bounds, header.degree)
    return count


def _attributes(table: SplatTable) -> dict[str, np.ndarray]:
    """Rows of each attribute's list."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        quats = table.quats / np.linalg.norm(table.quats, axis=1, keepdims=True)
    return {
        "positions": table.means,
        "orientations": quats,
        "scales": table.scales,
        "opacities": table.opacities[:, None],
        COEFFICIENTS: table.sh.reshape(-1, 3),
    }


def _about(units: Units, comments: list[str], *, antialiased: bool) -> str:
    """The beginning of the text: the metadata of the layer."""
    kept = [" ".join(each.split()) for each in comments if not each.startswith(PROGRAM)]
    notes = []
    if kept:
        notes.append(f"string[] comments = {json.dumps(kept, ensure_ascii=False)}")
    if antialiased:
        notes.append("bool antialiased = true")
    inner = "".join(f"            {each}\n" for each in notes)
    custom = f"        dictionary gsedit = {{\n{inner}        }}\n" if notes else ""
    custom = f'    customLayerData = {{\n        string creator = "gsedit"\n{custom}    }}\n'
    return (
        f'#usda 1.0\n(\n    defaultPrim = "Splats"\n    metersPerUnit = {units.meters:.9g}\n'
        f'    upAxis = "{units.up}"\n{custom})\n\n'
    )


def _assemble(
    path: Path,
    about: str,
    files: dict[str, IO[bytes]],
    bounds: Float32[np.ndarray, "2 3"],
    degree: int,
) -> None:
    low, high = (", ".join(f"{v:.9g}" for v in row) for row in bounds.tolist())
    with path.open("wb") as out:
        out.write(about.encode())
        out.write(f'def {SCHEMA} "Splats"\n{{\n'.encode())
        out.write(f"    float3[] extent = [({low}), ({high})]\n".encode())
        out.write(f"    uniform int {DEGREE} = {degree}\n".encode())
        for name, file in files.items():
            out.write(f"    {_KINDS[name]} {name} = [".encode())
            file.seek(0)
            shutil.copyfileobj(file, out, 1 << 20)
            size = (degree + 1) ** 2
            more = f' (\n        elementSize = {size}\n        interpolation = "vertex"\n    )'
            out.write(("]" + more * (name == COEFFICIENTS) + "\n").encode())
        out.write(b"}\n")
