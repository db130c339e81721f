"""OpenUSD's ParticleField3DGaussianSplat in .usda, .usd, .usdc and .usdz, through usd-core.

Scales and opacities are linear, rotations wxyz, SH as INRIA's, row after row. A stage is y up (or z
up, which is kept): memory's axes turned by 180 degrees about x, in the values and not as a
transform, so that they read the same without one. A child process runs the library, which reads
files of strangers in C++ and can crash on damaged ones; its memory and the bytes that it writes are
bounded. Between the two are files of plain numbers. The library holds the scene, and so does
writing here. Source: OpenUSD 26.11, the schemas of UsdVol; openusd.org.

The unit of length and the axis that is up are stated by a stage, and kept by other formats as
comments: `metersPerUnit 0.01`, `upAxis Z`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

import gsedit
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.axes import RUB, from_axes, to_axes
from gsedit.formats.limits import ALWAYS_BYTES
from gsedit.formats.quantised import LOGIT_MAX, log_scales_of, logits_of
from gsedit.formats.streams import (
    AT_ONCE,
    PROGRAM,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    gather,
)
from gsedit.formats.usd.child import COEFFICIENTS, ORIENTATIONS, SCHEMA, WIDTHS
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of
from gsedit.scene.table import SplatTable

_METERS, _UP = "metersPerUnit", "upAxis"
_AXES = {"Y": RUB, "Z": "RFU"}
"""Axes of a stage by the one that is up: x is right; what is up decides which one is front."""


@dataclass(frozen=True)
class Units:
    """Facts that a stage states about its space."""

    meters: float = 1.0
    """Meters in a unit of length; a scene that does not tell counts as one in meters."""
    up: str = "Y"

    @property
    def axes(self) -> str:
        """Name of the axes for `gsedit.formats.axes`."""
        return _AXES[self.up]

    @property
    def comments(self) -> tuple[str, ...]:
        """Comments that say what is not as usual."""
        meters = (f"{_METERS} {self.meters:.9g}",) if self.meters != 1 else ()
        return meters + ((f"{_UP} {self.up}",) if self.up != "Y" else ())


def units_of(stated: Mapping[str, Any]) -> Units:
    """The units that a stage states; X as the axis that is up is no more in USD."""
    meters, up = stated.get(_METERS, 1.0), stated.get(_UP, "Y")
    known = isinstance(meters, float) and isfinite(meters) and meters > 0
    return Units(meters if known else 1.0, up if up in ("Y", "Z") else "Y")


def units_in(comments: Sequence[str]) -> tuple[Units, list[str]]:
    """The units that comments state, and the other comments."""
    meters, up, others = 1.0, "Y", []
    for comment in comments:
        name, _, value = comment.partition(" ")
        if name == _METERS and _number(value) > 0:
            meters = _number(value)
        elif name == _UP and value in _AXES:
            up = value
        else:
            others.append(comment)
    return Units(meters, up), others


def rescaled(header: SceneHeader, factor: float | None) -> SceneHeader:
    """The header of a scene whose lengths were multiplied; None if by what is not known, which
    leaves a scene that does not tell its unit."""
    units, others = units_in(header.comments)
    if units.meters == 1:
        return header
    units = replace(units, meters=units.meters / factor if factor else 1.0)
    return header.replace(comments=(*others, *units.comments))


def _number(text: str) -> float:
    """A finite number; 0 for any other text."""
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if isfinite(value) else 0.0


_TEXT = b"#usda "
_BINARY = (b"PXR-USDC", b"PK\3\4")
"""Beginnings of a text, and of a binary layer and a package."""
_REACH = 3
"""Standard deviations that the extent holds: 99.7 % of a Gaussian along an axis, as the schema's
kernel is described."""

EXPANSION = 128
"""Bytes of numbers for a byte of a file: lists of equal numbers are packed well."""
TEXT = 8
"""Bytes of text for a byte of numbers, at most: 17 for the 4 of a float, and brackets."""
MEMORY = 1 << 31
"""Bytes of address space that the child may take beside what its files explain: the library
itself maps 0.4 GB."""
SECONDS = 60
"""CPU seconds that the child may take, and as many for every 10 MB."""
INSTALL = "pip install 'gsedit[usd]' (Python 3.11 or newer)"


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .usda, .usd, .usdc or .usdz with splats.

    Raises InputError for one without, or a damaged one; UsageError where usd-core is missing.
    """
    with path.open("rb") as file:
        start = file.read(8)
    if not start.startswith((_TEXT, *_BINARY)):
        raise InputError(f"{path} is no USD file, neither text nor binary: export it again")
    values = values_of(path)
    record = json.loads(values.path.with_suffix(".json").read_text(encoding="utf-8"))
    splats, units = record["splats"], units_of(record["units"])
    if not splats:
        raise InputError(
            f"{path} has no {SCHEMA} that is to be seen: export splats with that schema"
        )
    header = SceneHeader(
        max(each["degree"] for each in splats),
        comments=(*record["comments"], *units.comments),
        antialiased=record["antialiased"],
    )
    places = [_place(each, path) for each in splats]
    return SceneSource(
        path,
        "USD text" if start.startswith(_TEXT) else "USD",
        header,
        sum(each["count"] for each in splats),
        partial(_blocks, values, splats, places, units, header.degree),
        tuple(_notes(record, units)),
    )


def _place(splats: Mapping[str, Any], path: Path) -> Similarity:
    """The place of a definition's splats on the stage."""
    matrix = np.array(splats["matrix"], np.float64)
    try:
        return IDENTITY if (matrix == np.eye(4)).all() else similarity_of(matrix)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path}: {splats['name']} ({error}): export it again") from None


def _notes(record: Mapping[str, Any], units: Units) -> Iterator[str]:
    if record["others"]:
        yield f"meshes, points and other shapes left out: {record['others']}"
    if record["hidden"]:
        yield f"splats that the stage hides left out: {record['hidden']}"
    if len(record["splats"]) > 1:
        yield f"splats merged from {len(record['splats'])} definitions"
    if any(each["linear"] for each in record["splats"]):
        yield "its colors are said to be linear: read as those of a display, they look darker"
    if units.meters != 1:
        yield f"a unit is {units.meters:g} m: numbers stay as they are"


def _blocks(
    values: Scratch,
    splats: list[Mapping[str, Any]],
    places: list[Similarity],
    units: Units,
    degree: int,
) -> Blocks:
    """All rows; holds `values`, so that what is temporary stays until the last was read."""
    numbers = np.memmap(values.path, np.float32, "r") if values.path.stat().st_size else np.empty(0)
    for part, place in zip(splats, places):
        for start in range(0, part["count"], AT_ONCE):
            rows = min(AT_ONCE, part["count"] - start)
            read = {}
            for name, first in part["at"].items():
                wide = WIDTHS[name] * ((part["degree"] + 1) ** 2 if name == COEFFICIENTS else 1)
                own = numbers[first + start * wide :][: rows * wide]
                read[name] = np.array(own, np.float32).reshape(rows, wide)
            table = _table(read, rows, (degree + 1) ** 2)
            with np.errstate(invalid="ignore", over="ignore"):  # invalid rows are found later
                placed = table if place is IDENTITY else place.table(table)
            yield from_axes(placed, units.axes)


def _table(read: Mapping[str, Float32[np.ndarray, "m w"]], rows: int, k: int) -> SplatTable:
    """Some rows along the stage's axes; what is not in the file as the schema says."""
    sh = np.zeros((rows, k, 3), np.float32)
    if COEFFICIENTS in read:
        own = read[COEFFICIENTS].reshape(rows, -1, 3)
        sh[:, : own.shape[1]] = own
    quats = read.get(ORIENTATIONS)
    scales, opacities = read.get("scales"), read.get("opacities")
    return SplatTable(
        read["positions"],
        np.eye(1, 4, dtype=np.float32).repeat(rows, 0) if quats is None else quats,
        np.zeros((rows, 3), np.float32) if scales is None else log_scales_of(scales),
        np.full(rows, LOGIT_MAX, np.float32) if opacities is None else logits_of(opacities[:, 0]),
        sh,
    )


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write by the suffix: .usda as text, .usd and .usdc binary, .usdz a zip of a binary one; the
    number of rows. Axes and unit are those of the comments. Raises UsageError without usd-core."""
    check_installed(path)
    units, comments = units_in(header.comments)
    table = to_axes(gather(blocks, header, 0), units.axes)
    if not len(table):
        return 0
    folder = Path(tempfile.mkdtemp(prefix=".gs-usd-", dir=path.parent))
    try:
        size = 0
        for name, values in _attributes(table).items():
            np.ascontiguousarray(values, np.float32).tofile(folder / name.replace(":", "."))
            size += values.nbytes
        reach = _REACH * table.scales.max(1, keepdims=True)
        low, high = np.fmin.reduce(table.means - reach), np.fmax.reduce(table.means + reach)
        record = {
            "meters": units.meters, "up": units.up, "degree": header.degree,
            "extent": [low.tolist(), high.tolist()], "antialiased": header.antialiased,
            "comments": [" ".join(c.split()) for c in comments if not c.startswith(PROGRAM)],
        }  # fmt: skip
        (folder / "record.json").write_text(json.dumps(record), encoding="utf-8")
        reason = _run("write", folder, path, size, ALWAYS_BYTES + TEXT * size)
        if reason is not None:
            raise GseditError(f"{path} could not be written ({reason}): write another format")
    finally:
        shutil.rmtree(folder)
    return len(table)


def _attributes(table: SplatTable) -> dict[str, np.ndarray]:
    """Rows of each attribute."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        quats = table.quats / np.linalg.norm(table.quats, axis=1, keepdims=True)
    return {
        "positions": table.means,
        ORIENTATIONS: quats,
        "scales": table.scales,
        "opacities": table.opacities,
        COEFFICIENTS: table.sh,
    }


class Scratch:
    """A file in a folder of its own, removed with the last who holds it."""

    def __init__(self, name: str) -> None:
        folder = Path(tempfile.mkdtemp(prefix="gsedit-usd-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = folder / name

    def __fspath__(self) -> str:
        return str(self.path)

    __str__ = __fspath__


def values_of(path: Path) -> Scratch:
    """The numbers of a USD file's splats, with what they are in a .json beside them.

    Raises UsageError without usd-core, InputError for a file that it cannot read.
    """
    check_installed(path)
    scratch = Scratch("values")
    size = path.stat().st_size
    most = max(ALWAYS_BYTES, EXPANSION * size)
    reason = _run("read", path, scratch.path, size, most)
    if reason is not None and scratch.path.exists() and scratch.path.stat().st_size >= most:
        reason = f"it unpacks to more than {most >> 20} MB"
    if reason is not None:
        raise InputError(f"{path} cannot be read as USD ({reason}): export it again")
    return scratch


def check_installed(path: Path) -> None:
    """Raise UsageError without usd-core."""
    if find_spec("pxr") is None:
        raise UsageError(f"{path}: USD needs usd-core: {INSTALL}")


def _run(task: str, source: Path, target: Path, size: int, written: int) -> str | None:
    """Run a task of `child.py`; what went wrong, as one line, or None."""
    limits = (MEMORY + 32 * size + written, written, SECONDS * (1 + size // 10**7))
    done = subprocess.run(
        [sys.executable, "-m", "gsedit.formats.usd.child", task, str(source.absolute()),
         str(target.absolute()), *map(str, limits)],
        stdin=subprocess.DEVNULL, capture_output=True, check=False,
        cwd=Path(gsedit.__file__).parents[1],  # not where a stranger's pxr.py may lie
        env={**os.environ, "PXR_WORK_THREAD_LIMIT": "1"},
    )  # fmt: skip
    if done.returncode == 0 and target.exists():
        return None
    told = done.stdout.decode("utf-8", "replace").strip().splitlines()
    return told[-1][:200] if told and done.returncode == 1 else "usd-core ended on it"
