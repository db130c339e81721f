"""The .ply of INRIA's 3D Gaussian Splatting: one float column a number, one row a Gaussian.

`n` Gaussians, `k` SH coefficients a channel. Scales are logarithms, opacities logits, rotations
wxyz; f_rest is channel-major in the file (all of red, all of green, ...), coefficient-major here.
"""

from __future__ import annotations

from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.files.ply import PlyHeader, read_ply
from rasterizer.scene import Gaussians

MAX_DEGREE = 3  # INRIA's layout ends at 45 f_rest columns; no reader expects more
AT_ONCE = 1 << 18
"""Rows that are read or written at a time: 65 MB."""
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
    """The column of every number of `Gaussians`, in the shape of one row of each field."""
    return {
        "means": np.array(_MEANS),
        "quats": np.array(_QUATS),
        "log_scales": np.array(_SCALES),
        "logit_opacities": np.array("opacity"),
        "sh": np.array(sh_columns(k)),
    }


def read_inria(path: Path, header: PlyHeader) -> tuple[Gaussians, tuple[str, ...]]:
    """The scene, float32, and notes on what the file holds beyond it.

    Read in pieces where the file is binary and plain, so that memory holds the scene and little
    else; otherwise as a whole: any column order and type, ASCII, big-endian, more elements. Raises
    InputError where columns of a splat are missing.
    """
    vertex = header.element("vertex")
    k = _coefficients(path, vertex.names if vertex else ())
    splat_columns = {*columns(k), *_NORMALS}
    extra = [name for name in (vertex.names if vertex else ()) if name not in splat_columns]
    others = [e.name for e in header.elements if e.name != "vertex"]
    notes = [f"columns left out: {', '.join(extra)}"] if extra else []
    notes += [f"elements left out: {', '.join(others)}"] if others else []
    scene = _in_pieces(path, header, k) if _is_plain(header) else _tolerant(path, k)
    return scene, tuple(notes)


def write_inria(scene: Gaussians, path: Path) -> None:
    """Write INRIA's layout, float32, little-endian, no comments (some viewers fail on them).

    Not through gsply, which leaves out the normals: INRIA's own viewer reads 62 columns unchecked.
    Raises UsageError for a scene of a higher SH degree than 3.
    """
    if scene.degree > MAX_DEGREE:
        raise UsageError(
            f"{path}: .ply holds SH up to degree {MAX_DEGREE}, the scene has {scene.degree}: "
            "reduce its SH degree first"
        )
    n, k = scene.sh.shape[:2]
    lines = [f"property float {name}" for name in columns(k)]
    start = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    with path.open("wb") as handle:
        handle.write("\n".join([*start, *lines, "end_header\n"]).encode("ascii"))
        for start in range(0, n, AT_ONCE):
            _rows(scene[start : start + AT_ONCE]).numpy().astype("<f4", copy=False).tofile(handle)


def _rows(scene: Gaussians) -> Float[Tensor, "n columns"]:
    """What the file holds of each Gaussian, in the order of `columns`."""
    rest = scene.sh[:, 1:].transpose(1, 2).flatten(1)  # to channel-major
    normals = torch.zeros_like(scene.means)
    opacity = scene.logit_opacities[:, None]
    fields = (scene.means, normals, scene.sh[:, 0], rest, opacity, scene.log_scales, scene.quats)
    return torch.cat(fields, dim=1)


def from_gsply(data: Any) -> Gaussians:
    """The scene of gsply's GSData: log scales, logit opacities, SH in two parts."""
    bands = [data.sh0[:, None]]
    if data.shN is not None:  # None from .spz of degree 0, an empty array from .ply
        bands.append(data.shN.reshape(len(data), data.shN.shape[1], 3))
    sh = np.concatenate(bands, axis=1)
    arrays = (data.means, data.quats, data.scales, data.opacities.reshape(-1), sh)
    # copied: the arrays are views into one table, which would stay in memory
    return Gaussians(*(torch.from_numpy(np.array(a, dtype=np.float32, order="C")) for a in arrays))


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


def _in_pieces(path: Path, header: PlyHeader, k: int) -> Gaussians:
    """The scene of a plain file, a part of its rows at a time."""
    vertex = header.elements[0]
    at = {name: index for index, name in enumerate(vertex.names)}
    places = {
        field: np.vectorize(at.__getitem__)(names) for field, names in field_columns(k).items()
    }
    fields = {
        field: np.empty((vertex.count, *place.shape), np.float32) for field, place in places.items()
    }
    with path.open("rb") as handle:
        handle.seek(header.data_offset)
        for start in range(0, vertex.count, AT_ONCE):
            count = min(AT_ONCE, vertex.count - start)
            rows = np.fromfile(handle, "<f4", count * len(at)).reshape(count, len(at))
            for field, place in places.items():
                np.take(rows, place, axis=1, out=fields[field][start : start + count])
    return Gaussians(**{field: torch.from_numpy(values) for field, values in fields.items()})


def _tolerant(path: Path, k: int) -> Gaussians:
    """The scene by our own reader: columns by name, in any order and type."""
    vertex = read_ply(path).elements.get("vertex")
    if vertex is None:
        raise InputError(f"{path}: a list element stands before vertex: export it without faces")

    def gather(names: np.ndarray) -> Float[Tensor, "n ..."]:
        with np.errstate(over="ignore"):  # a double beyond float32 becomes inf: `load` refuses it
            parts = [vertex[name].astype(np.float32) for name in names.ravel().tolist()]
        return torch.from_numpy(np.stack(parts, axis=-1).reshape(len(vertex), *names.shape))

    return Gaussians(**{field: gather(names) for field, names in field_columns(k).items()})
