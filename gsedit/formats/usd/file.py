"""OpenUSD's ParticleField3DGaussianSplat: .usda by gsedit, .usd, .usdc and .usdz through usd-core.

Scales and opacities are linear, rotations wxyz, SH as INRIA's, row after row. A stage is y up (or z
up, which is kept): memory's axes turned by 180 degrees about x, in the values and not as a
transform, so that they read the same without one. Binary files are text in between, written and
read by a child process. Reading holds one block; writing keeps each attribute in a file of its own.
Source: OpenUSD 26.11, the schemas of UsdVol; openusd.org.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.formats.axes import from_axes
from gsedit.formats.quantised import LOGIT_MAX, log_scales_of, logits_of
from gsedit.formats.streams import (
    AT_ONCE,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
)
from gsedit.formats.usd.library import Scratch, flattened, packed
from gsedit.formats.usd.stage import COEFFICIENTS, SCHEMA, Found, Splats, find_splats
from gsedit.formats.usd.text import MAGIC, NeedsLibrary, Prim, read_layer
from gsedit.formats.usd.units import Units, units_of
from gsedit.formats.usd.writing import write_text
from gsedit.scene.similarity import IDENTITY
from gsedit.scene.table import SplatTable

_BINARY = (b"PXR-USDC", b"PK\3\4")
"""Beginnings of a binary layer and of a package."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .usda, .usd, .usdc or .usdz with splats.

    Raises InputError for one without, or a damaged one; UsageError where usd-core is needed and
    missing: for binary files, and for those that are put together from others.
    """
    with path.open("rb") as file:
        start = file.read(8)
    is_text = start.startswith(MAGIC)
    if not is_text and not start.startswith(_BINARY):
        raise InputError(f"{path} is no USD file, neither text nor binary: export it again")
    text = path if is_text else flattened(path, "it is binary")
    try:
        layer = read_layer(Path(text))
    except NeedsLibrary as error:
        text = flattened(path, str(error))
        layer = read_layer(Path(text))
    except InputError as error:
        raise _named(error, text, path) from None
    try:
        found, units = find_splats(layer, Path(text)), units_of(layer)
    except InputError as error:
        raise _named(error, text, path) from None
    if not found.splats:
        raise InputError(
            f"{path} has no {SCHEMA} that is to be seen: export splats with that schema"
        )
    about = _about(layer)
    kept = about.get("comments")
    comments = [c for c in kept if isinstance(c, str)] if isinstance(kept, list) else []
    header = SceneHeader(
        max(each.degree for each in found.splats),
        comments=(*comments, *units.comments),
        antialiased=about.get("antialiased") in ("true", 1.0),
    )
    return SceneSource(
        path,
        "USD text" if is_text else "USD",
        header,
        sum(each.count for each in found.splats),
        partial(_blocks, text, found.splats, units, path),
        tuple(_notes(found, units)),
    )


def _named(error: InputError, text: Path | Scratch, path: Path) -> InputError:
    """The error with the name of the file that was given."""
    return InputError(str(error).replace(str(text), str(path)))


def _about(layer: Prim) -> dict[str, Any]:
    """Facts beside the splats that gsedit's writer noted: comments, antialiased."""
    custom = layer.metadata.get("customLayerData")
    about = custom.get("gsedit") if isinstance(custom, dict) else None
    return about if isinstance(about, dict) else {}


def _notes(found: Found, units: Units) -> Iterator[str]:
    if found.others:
        yield f"meshes, points and other shapes left out: {found.others}"
    if found.hidden:
        yield f"splats that the stage hides left out: {found.hidden}"
    if len(found.splats) > 1:
        yield f"splats merged from {len(found.splats)} definitions"
    if any(each.linear for each in found.splats):
        yield "its colors are said to be linear: read as those of a display, they look darker"
    if units.meters != 1:
        yield f"a unit is {units.meters:g} m: numbers stay as they are"


def _blocks(text: Path | Scratch, splats: tuple[Splats, ...], units: Units, path: Path) -> Blocks:
    """All rows; holds `text`, so that what is temporary stays until the last was read."""
    k = (max(each.degree for each in splats) + 1) ** 2
    for part in splats:
        lists = {name: part.list(name) for name in part.lists}
        for start in range(0, part.count, AT_ONCE):
            rows = min(AT_ONCE, part.count - start)
            try:
                read = {n: each.take(rows * _wide(n, part)) for n, each in lists.items()}
                table = _table(read, part, rows, k)
            except InputError as error:
                raise _named(error, text, path) from None
            with np.errstate(invalid="ignore", over="ignore"):  # invalid rows are found later
                placed = table if part.place is IDENTITY else part.place.table(table)
            yield from_axes(placed, units.axes)


def _wide(name: str, part: Splats) -> int:
    """Entries of an attribute's list for each row."""
    return (part.degree + 1) ** 2 if name == COEFFICIENTS else 1


def _table(
    read: Mapping[str, Float32[np.ndarray, "m w"]], part: Splats, rows: int, k: int
) -> SplatTable:
    """Some rows along the stage's axes; what is not in the file as the schema says."""
    for name, values in read.items():
        if len(values) < rows * _wide(name, part):
            raise InputError(f"{part.path}: {name} of {part.name} end early: export it again")
    sh = np.zeros((rows, k, 3), np.float32)
    if COEFFICIENTS in read:
        sh[:, : _wide(COEFFICIENTS, part)] = read[COEFFICIENTS].reshape(rows, -1, 3)
    quats = read.get("orientations")
    scales, opacities = read.get("scales"), read.get("opacities")
    return SplatTable(
        read["positions"],
        np.eye(1, 4, dtype=np.float32).repeat(rows, 0) if quats is None else quats,
        np.zeros((rows, 3), np.float32) if scales is None else log_scales_of(scales),
        np.full(rows, LOGIT_MAX, np.float32) if opacities is None else logits_of(opacities[:, 0]),
        sh,
    )


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write by the suffix: .usda as text, .usd and .usdc binary, .usdz a zip of a binary one; the
    number of rows. Raises UsageError where usd-core is needed and missing."""
    if path.name.lower().endswith(".usda"):
        return write_text(path, header, blocks)
    with packed(path) as text:
        return write_text(text, header, blocks)
