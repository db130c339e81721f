"""The .ply of INRIA's 3D Gaussian Splatting: one float column a number, one row a Gaussian.

`n` Gaussians, `k` SH coefficients a channel. Scales are logarithms, opacities logits, rotations
wxyz; f_rest is channel-major in the file (all of red, all of green, ...), coefficient-major here.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isqrt, log
from pathlib import Path

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured

from gsedit.errors import InputError, UsageError
from gsedit.formats.ply.records import (
    PlyElement,
    PlyHeader,
    element_blocks,
    element_header,
    other_elements,
    read_ply_header,
)
from gsedit.formats.streams import (
    AT_ONCE,
    PROGRAM,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    in_blocks,
)
from gsedit.scene.table import SplatTable

_REST_COUNTS = (0, 9, 24, 45, 72)  # 3 ((degree + 1)^2 - 1)
SPLAT = "the splat"
"""The field of a record that holds all columns of a splat: no column of a file can have a space."""
_MEANS = ("x", "y", "z")
_NORMALS = ("nx", "ny", "nz")
_SCALES = ("scale_0", "scale_1", "scale_2")
_QUATS = ("rot_0", "rot_1", "rot_2", "rot_3")
FLAT = log(1e-6)
"""The scale_2 of a 2D splat, which has none: a disk a millionth of a unit thick. That is thinner
than a pixel in any view, and its square is far from the smallest float32."""
ELEMENTS_MAX_BYTES = 16 << 20
"""Largest size in bytes of an element beside the splats that is kept: SHARP's cameras take some
hundred bytes."""
MIP_COMMENTS = ("antialiased 1", "SplatRenderMode: mip")
"""How Postshot and Brush mark a scene that was trained with Mip-Splatting's filter."""


def sh_columns(k: int) -> tuple[tuple[str, str, str], ...]:
    """The file's name of every SH coefficient: k rows of three channels."""
    rest = k - 1
    dc = (("f_dc_0", "f_dc_1", "f_dc_2"),)
    return dc + tuple(tuple(f"f_rest_{c * rest + i}" for c in range(3)) for i in range(rest))  # pyright: ignore[reportReturnType]


def columns(k: int) -> tuple[str, ...]:
    """All columns in INRIA's order: 62 at degree 3."""
    rest = tuple(f"f_rest_{i}" for i in range(3 * (k - 1)))
    return (*_MEANS, *_NORMALS, *sh_columns(k)[0], *rest, "opacity", *_SCALES, *_QUATS)


def field_columns(k: int) -> dict[str, np.ndarray]:
    """The column of every number of a `SplatTable`, in the shape of one row of each field."""
    return {
        "means": np.array(_MEANS),
        "quats": np.array(_QUATS),
        "log_scales": np.array(_SCALES),
        "logit_opacities": np.array("opacity"),
        "sh": np.array(sh_columns(k)),
    }


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .ply with one column a number: any column order and type, ASCII, big-endian, with
    other elements, comments and columns.

    Raises InputError where columns of a splat are missing.
    """
    header = read_ply_header(path)
    vertex = header.element("vertex") or PlyElement("vertex", 0, ())
    k = _coefficients(path, vertex.names)
    known = {*columns(k), *_NORMALS}
    kinds = vertex.dtype("=") if not vertex.has_lists else np.dtype([])
    normals = _normals(path, header, vertex)
    extra = {
        name: kinds[name] for name in kinds.names or () if name in normals or name not in known
    }
    elements, left_out = other_elements(path, header, "vertex", ELEMENTS_MAX_BYTES)
    notes = [f"elements left out: {', '.join(left_out)}"] if left_out else []
    notes += ["no column scale_2: 2D splats, read as disks 1e-6 thick"] * _is_flat(vertex.names)
    scene = SceneHeader(
        isqrt(k) - 1,
        extra,
        header.comments,
        elements,
        antialiased=any(c.strip() in MIP_COMMENTS for c in header.comments),
    )
    blocks = partial(_read, path, header, k, tuple(extra))
    return SceneSource(path, "INRIA .ply", scene, vertex.count, blocks, tuple(notes))


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write INRIA's layout, float32, little-endian, then extra columns and elements; the number
    of rows. Comments are the source's own: a file that had none gets none, as some viewers fail
    on them.

    Not through gsply, which leaves out the normals: INRIA's own viewer reads 62 columns unchecked.
    The count is written last, over ten digits: leading zeros are part of a number to every reader.
    """
    k = (header.degree + 1) ** 2
    names = columns(k)
    kinds = {name: _stored(path, name, kind) for name, kind in beside(path, header).items()}
    row = np.dtype([(SPLAT, "<f4", len(names)), *kinds.items()])
    comments = [" ".join(c.split()) for c in header.comments if not c.startswith(PROGRAM)]
    if header.antialiased and not set(comments) & set(MIP_COMMENTS):
        comments.append(MIP_COMMENTS[0])  # needed to draw it right: worth a comment
    start = "ply\nformat binary_little_endian 1.0\n" + "".join(f"comment {c}\n" for c in comments)
    start = f"{start}element vertex ".encode()
    rest = element_header(np.dtype([*((name, "<f4") for name in names), *kinds.items()]))
    for name, rows in header.elements.items():
        rest += f"element {name} {len(rows)}\n" + element_header(rows.dtype)
    count = 0
    with path.open("wb") as handle:
        handle.write(start + b"%010d\n" % 0)
        handle.write(f"{rest}end_header\n".encode())
        for block in blocks:
            for part in in_blocks(block):
                rows_of(part, row).tofile(handle)
                count += len(part)
        for rows in header.elements.values():
            rows.astype(rows.dtype.newbyteorder("<")).tofile(handle)
        handle.seek(len(start))
        handle.write(b"%010d" % count)
    return count


def beside(path: Path, header: SceneHeader) -> dict[str, np.dtype]:
    """The columns to be written behind those of the splat, which have a place for normals.

    Raises UsageError for a name that a splat's column has, or that is no single word.
    """
    own = columns((header.degree + 1) ** 2)
    kinds = {name: kind for name, kind in header.extra.items() if name not in _NORMALS}
    for name in kinds:
        if name in own or name.split() != [name]:
            raise UsageError(f"{path}: a column cannot be named {name!r}: rename it")
    return kinds


def _stored(path: Path, name: str, kind: np.dtype) -> np.dtype:
    """The type of an extra column in the file."""
    kind = np.dtype(np.uint8) if kind == np.bool_ else np.dtype(kind)
    if kind.kind not in "iuf" or kind.itemsize > 8:
        raise UsageError(f"{path}: .ply holds numbers only, column {name} is {kind}: leave it out")
    return kind.newbyteorder("<")


def rows_of(table: SplatTable, row: np.dtype) -> np.ndarray:
    """Rows as the file holds them: the numbers in the order of `columns`, then the extra columns,
    as records of type `row`."""
    n, k = table.sh.shape[:2]
    rows = np.empty(n, row)
    splat = rows[SPLAT]
    splat[:, 0:3], splat[:, 6:9] = table.means, table.sh[:, 0]
    for column, name in enumerate(_NORMALS, 3):
        splat[:, column] = table.extra.get(name, 0)
    rest = splat[:, 9 : 6 + 3 * k]  # a view, as its reshape is
    rest.reshape(n, 3, k - 1)[:] = table.sh[:, 1:].transpose(0, 2, 1)  # to channel-major
    splat[:, -8], splat[:, -7:-4] = table.logit_opacities, table.log_scales
    splat[:, -4:] = table.quats
    for name in row.names or ():
        if name != SPLAT:
            rows[name] = table.extra[name]
    return rows


def is_splats(names: tuple[str, ...]) -> bool:
    """Whether columns are those of splats: any that a mesh or a point cloud never has."""
    return any(name.startswith(("f_dc_", "f_rest_", "scale_", "rot_")) for name in names)


def _coefficients(path: Path, names: tuple[str, ...]) -> int:
    """k, from the number of f_rest columns; InputError where splat columns are missing."""
    count = sum(name.startswith("f_rest_") for name in names)
    needed = next((rest for rest in _REST_COUNTS if rest >= count), _REST_COUNTS[-1])
    k = 1 + needed // 3
    missing = [c for c in columns(k) if c not in names and c not in _NORMALS]
    basic = [c for c in missing if not c.startswith("f_rest_")]
    if basic and not _is_flat(names):
        raise InputError(
            f"{path} is no splat scene, columns {', '.join(basic)} are missing: export it again"
        )
    if count != needed or any(c.startswith("f_rest_") for c in missing):
        raise InputError(
            f"{path} has {count} f_rest columns; degree {isqrt(k) - 1} needs {needed}. "
            "Was it cropped? Export it again"
        )
    return k


def _is_flat(names: tuple[str, ...]) -> bool:
    """Whether they are the columns of 2D Gaussian splatting: those of splats without scale_2."""
    return "scale_2" not in names and {*columns(1)} - {*names, *_NORMALS} == {"scale_2"}


def _normals(path: Path, header: PlyHeader, vertex: PlyElement) -> tuple[str, ...]:
    """The columns of normals, if they are not the zeros that INRIA's files have; the first rows
    tell."""
    names = tuple(name for name in _NORMALS if name in vertex.names)
    if not names or vertex.has_lists or not vertex.count:
        return ()
    first = next(element_blocks(path, header, "vertex", 4096))  # rows that are all zero tell
    return names if any((first[name] != 0).any() for name in names) else ()


def _read(path: Path, header: PlyHeader, k: int, extra: tuple[str, ...]) -> Blocks:
    """The rows, some at a time."""
    vertex = header.element("vertex")
    if vertex is not None and vertex.count:
        for rows in element_blocks(path, header, "vertex", AT_ONCE):
            yield _table(rows, k, extra)


def _table(rows: np.ndarray, k: int, extra: tuple[str, ...]) -> SplatTable:
    """Records as a table."""

    def take(names: Sequence[str]) -> np.ndarray:
        return structured_to_unstructured(rows[list(names)])

    sh = np.empty((len(rows), k, 3), np.float32)
    with np.errstate(over="ignore"):  # a double beyond float32 becomes inf: found later
        sh[:, 0] = take(sh_columns(1)[0])
        if k > 1:
            rest = take([f"f_rest_{i}" for i in range(3 * (k - 1))])
            sh[:, 1:] = rest.reshape(len(rows), 3, k - 1).transpose(0, 2, 1)
        log_scales = np.full((len(rows), 3), FLAT, np.float32)
        present = [name for name in _SCALES if name in (rows.dtype.names or ())]
        log_scales[:, : len(present)] = take(present)
        fields = (take(_MEANS), take(_QUATS), log_scales, rows["opacity"])
        means, quats, log_scales, logits = (np.array(f, np.float32, order="C") for f in fields)
    kept = {name: rows[name].astype(rows.dtype[name].newbyteorder("=")) for name in extra}
    return SplatTable(means, quats, log_scales, logits, sh, extra=kept)
