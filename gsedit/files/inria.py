"""The .ply of INRIA's 3D Gaussian Splatting: one float column a number, one row a Gaussian.

`n` Gaussians, `k` SH coefficients a channel. Scales are logarithms, opacities logits, rotations
wxyz; f_rest is channel-major in the file (all of red, all of green, ...), coefficient-major here.
"""

from __future__ import annotations

from functools import partial
from math import isqrt
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.files.ply import PlyHeader, read_ply, read_ply_header
from gsedit.files.streams import (
    AT_ONCE,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
    in_blocks,
)
from gsedit.files.table import SplatTable

MAX_DEGREE = 3  # INRIA's layout ends at 45 f_rest columns; no reader expects more
_REST_COUNTS = (0, 9, 24, 45)  # 3 ((degree + 1)^2 - 1)
_MEANS = ("x", "y", "z")
_NORMALS = ("nx", "ny", "nz")
_SCALES = ("scale_0", "scale_1", "scale_2")
_QUATS = ("rot_0", "rot_1", "rot_2", "rot_3")


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


def open_inria(path: Path, header: PlyHeader) -> SceneSource:
    """The splats of a PLY with one column a number: any column order and type, ASCII, big-endian.

    Read in pieces where the file is binary and plain; otherwise as a whole. Raises InputError where
    columns of a splat are missing.
    """
    vertex = header.element("vertex")
    k = _coefficients(path, vertex.names if vertex else ())
    splat_columns = {*columns(k), *_NORMALS}
    extra = [name for name in (vertex.names if vertex else ()) if name not in splat_columns]
    others = [e.name for e in header.elements if e.name != "vertex"]
    notes = [f"columns left out: {', '.join(extra)}"] if extra else []
    notes += [f"elements left out: {', '.join(others)}"] if others else []
    read = _in_pieces if _is_plain(header) else _tolerant
    return SceneSource(
        path,
        "INRIA .ply",
        SceneHeader(isqrt(k) - 1, comments=header.comments),
        vertex.count if vertex else 0,
        partial(read, path, header, k),
        tuple(notes),
    )


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .ply with one column a number."""
    return open_inria(path, read_ply_header(path))


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write INRIA's layout, float32, little-endian, no comments (some viewers fail on them); the
    number of rows.

    Not through gsply, which leaves out the normals: INRIA's own viewer reads 62 columns unchecked.
    The count is written last, over ten digits: leading zeros are part of a number to every reader.
    """
    k = (header.degree + 1) ** 2
    lines = [f"property float {name}" for name in columns(k)]
    start = b"ply\nformat binary_little_endian 1.0\nelement vertex "
    count = 0
    with path.open("wb") as handle:
        handle.write(start + b"%010d\n" % 0)
        handle.write("\n".join([*lines, "end_header\n"]).encode("ascii"))
        for block in blocks:
            for part in in_blocks(block):
                _rows(part).astype("<f4", copy=False).tofile(handle)
                count += len(part)
        handle.seek(len(start))
        handle.write(b"%010d" % count)
    return count


def _rows(table: SplatTable) -> Float32[np.ndarray, "n columns"]:
    """What the file holds of each Gaussian, in the order of `columns`."""
    rest = table.sh[:, 1:].transpose(0, 2, 1).reshape(len(table), -1)  # to channel-major
    normals = np.zeros_like(table.means)
    opacity = table.logit_opacities[:, None]
    fields = (table.means, normals, table.sh[:, 0], rest, opacity, table.log_scales, table.quats)
    return np.concatenate(fields, axis=1)


def _coefficients(path: Path, names: tuple[str, ...]) -> int:
    """k, from the number of f_rest columns; InputError where splat columns are missing."""
    count = sum(name.startswith("f_rest_") for name in names)
    needed = next((rest for rest in _REST_COUNTS if rest >= count), _REST_COUNTS[-1])
    k = 1 + needed // 3
    missing = [c for c in columns(k) if c not in names and c not in _NORMALS]
    basic = [c for c in missing if not c.startswith("f_rest_")]
    if basic == ["scale_2"]:
        raise InputError(f"{path} has no column scale_2: it holds 2D splats, export 3D ones")
    if basic:
        raise InputError(
            f"{path} is no splat scene, columns {', '.join(basic)} are missing: "
            "a mesh or point cloud has none, `gsedit fit` makes splats from photos"
        )
    if missing or count > needed:
        raise InputError(
            f"{path} has {count} f_rest columns; degree {isqrt(k) - 1} needs {needed}. "
            "Was it cropped? Export it again"
        )
    return k


def _is_plain(header: PlyHeader) -> bool:
    """Whether it holds floats in rows and nothing else."""
    return (
        header.format == "binary_little_endian"
        and len(header.elements) == 1
        and all(kind == "float" for _, kind in header.elements[0].columns)
    )


def _in_pieces(path: Path, header: PlyHeader, k: int) -> Blocks:
    """The rows of a plain file, some at a time."""
    vertex = header.elements[0]
    at = {name: index for index, name in enumerate(vertex.names)}
    places = {
        field: np.vectorize(at.__getitem__)(names) for field, names in field_columns(k).items()
    }
    with path.open("rb") as handle:
        handle.seek(header.data_offset)
        for start in range(0, vertex.count, AT_ONCE):
            count = min(AT_ONCE, vertex.count - start)
            rows = np.fromfile(handle, "<f4", count * len(at))
            if rows.size < count * len(at):
                raise InputError(f"{path} became shorter while it was read: copy it again")
            rows = rows.reshape(count, len(at))
            yield SplatTable(**{f: rows.take(place, axis=1) for f, place in places.items()})  # pyright: ignore[reportArgumentType]


def _tolerant(path: Path, header: PlyHeader, k: int) -> Blocks:
    """The rows by our own reader: columns by name, in any order and type."""
    vertex = read_ply(path).elements.get("vertex")
    if vertex is None:
        raise InputError(f"{path}: a list element stands before vertex: export it without faces")

    def gather(names: np.ndarray) -> Float32[np.ndarray, "n ..."]:
        with np.errstate(over="ignore"):  # a double beyond float32 becomes inf: found later
            parts = [vertex[name].astype(np.float32) for name in names.ravel().tolist()]
        return np.stack(parts, axis=-1).reshape(len(vertex), *names.shape)

    fields = {f: gather(names) for f, names in field_columns(k).items()}
    yield from in_blocks(SplatTable(**fields))  # pyright: ignore[reportArgumentType]
