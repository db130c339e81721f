"""Scene files to be damaged: a builder for every format, and damage inside of what protects it."""

from __future__ import annotations

import base64
import json
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from fuzzing import Damage, in_glb, in_gzip, in_json, in_zip, in_zstd
from ksplat_files import ksplat

from gsedit.formats.ply.records import read_ply_header
from gsedit.formats.registry import write_scene
from gsedit.formats.streams import SceneHeader, WriteOptions, in_blocks
from gsedit.scene.table import SplatTable


@dataclass(frozen=True)
class Subject:
    """A format to be damaged."""

    name: str
    """Name of the file."""
    build: Callable[[Path, SplatTable], object]
    inner: Damage | None = None
    """Damage below what checksums and brackets protect."""
    share: float = 1.0
    """Part of the times that are asked for: half a second each, where a child process reads."""


def _write(path: Path, table: SplatTable, version: int = 3) -> None:
    header = SceneHeader(table.degree, {n: c.dtype for n, c in table.extra.items()})
    write_scene(path, header, in_blocks(table), options=WriteOptions(spz_version=version))


def _ascii(path: Path, table: SplatTable) -> None:
    _write(path, table)
    at = read_ply_header(path).data_offset
    raw = path.read_bytes()
    rows = np.frombuffer(raw[at:], "<f4").reshape(len(table), -1)
    text = "\n".join(" ".join(f"{v:.6g}" for v in row) for row in rows)
    path.write_bytes(raw[:at].replace(b"binary_little_endian", b"ascii") + text.encode() + b"\n")


def _gltf(path: Path, table: SplatTable) -> None:
    other = path.with_suffix(".glb")
    _write(other, table)
    raw = other.read_bytes()
    other.unlink()
    (length,) = struct.unpack_from("<I", raw, 12)
    scene = json.loads(raw[20 : 20 + length])
    data = base64.b64encode(raw[28 + length :]).decode()
    scene["buffers"][0]["uri"] = "data:application/octet-stream;base64," + data
    path.write_text(json.dumps(scene))


def _folder(path: Path, table: SplatTable) -> None:
    other = path.with_name("a.sog")
    _write(other, table)
    with zipfile.ZipFile(other) as archive:
        archive.extractall(path.parent)
    other.unlink()


USD_CORE = ("usda", "usdc", "usdz")
"""Suffixes that usd-core reads."""
SUBJECTS = (
    Subject("a.ply", _write),
    Subject("ascii.ply", _ascii),
    Subject("a.compressed.ply", _write),
    Subject("a.splat", lambda path, table: _write(path, table.replace(sh=table.sh[:, :1]))),
    Subject("a.ksplat", lambda path, table: ksplat(path, 1, table)),
    Subject("3.spz", _write, in_gzip),
    Subject("4.spz", lambda path, table: _write(path, table, 4), in_zstd),
    Subject("a.sog", _write, in_zip),
    Subject("meta.json", _folder, in_json),
    Subject("a.glb", _write, in_glb),
    Subject("a.gltf", _gltf, in_json),
    *(Subject(f"a.{end}", _write, share=0.02) for end in USD_CORE if find_spec("pxr")),
    Subject("a.npz", _write, in_zip),
)
