"""Files of Spark's .rad, written here by the layout of its encoder (rust/spark-lib/src/rad.rs)."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.scene.table import SplatTable

USUAL = {
    "center": "f32_lebytes", "alpha": "r8", "rgb": "r8_delta", "scales": "ln_0r8",
    "orientation": "oct88r8", "sh1": "s8", "sh2": "s8", "sh3": "s8",
}  # fmt: skip
"""Encodings that Spark's writer chooses."""
PLAIN = {
    "center": "f32", "alpha": "f32", "rgb": "f32", "scales": "f32", "orientation": "f32",
    "sh1": "f32", "sh2": "f32", "sh3": "f32",
}  # fmt: skip
RANGES = {"alpha": (0.0, 1.0), "rgb": (-0.5, 1.5), "scales": (-12.0, 9.0), "sh": (-1.0, 1.0)}


def encoded(values: np.ndarray, encoding: str, least: float, most: float) -> bytes:
    """A column of rows (n, w), number after number."""
    columns = np.ascontiguousarray(values.T)
    kind = {"f32": "<f4", "f16": "<f2", "u16": "<u2", "u32": "<u4"}.get(encoding)
    if kind:
        return columns.astype(kind).tobytes()
    if encoding.endswith("_lebytes"):
        raw = columns.astype("<f4" if encoding[1:3] == "32" else "<f2").view(np.uint8)
        size = 4 if encoding[1:3] == "32" else 2
        return raw.reshape(-1, size).T.tobytes()
    if encoding == "ln_f16":
        return np.log(columns).astype("<f2").tobytes()
    if encoding == "ln_0r8":
        steps = np.rint((np.log(columns) - least) / (most - least) * 254).clip(0, 254) + 1
        return steps.astype(np.uint8).tobytes()
    if encoding.startswith("s8"):
        steps = np.rint(columns / most * 127).clip(-127, 127).astype(np.int8).view(np.uint8)
    else:
        steps = np.rint((columns - least) / (most - least) * 255).clip(0, 255).astype(np.uint8)
    if encoding.endswith("_delta"):
        steps = np.diff(steps, axis=1, prepend=np.uint8(0))
    return steps.astype(np.uint8).tobytes()


def octahedral(quats: np.ndarray) -> bytes:
    """Rotations wxyz (n, 4) as three bytes a row: axis on an octahedron, angle."""
    quats = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    quats = quats * np.where(quats[:, :1] < 0, -1, 1)
    half = np.arccos(quats[:, :1].clip(0, 1))
    axis = quats[:, 1:] / np.maximum(np.sin(half), 1e-9)
    axis /= np.abs(axis).sum(1, keepdims=True)
    flat = axis[:, :2].copy()
    folded = (1 - np.abs(flat[:, ::-1])) * np.where(flat >= 0, 1, -1)
    flat = np.where(axis[:, 2:] < 0, folded, flat)
    steps = np.concatenate(((flat + 1) / 2, 2 * half / np.pi), 1)
    return np.rint(steps * 255).clip(0, 255).astype(np.uint8).tobytes()


def columns_of(
    table: SplatTable, encodings: Mapping[str, str], labels: np.ndarray | None
) -> dict[str, tuple[bytes, str, float, float]]:
    """Packed columns by name: bytes, encoding, range."""
    quats = table.quats / np.linalg.norm(table.quats, axis=1, keepdims=True)
    values = {
        "center": table.means, "alpha": table.opacities[:, None], "rgb": table.colors,
        "scales": table.scales, "orientation": quats[:, 1:] * np.where(quats[:, :1] < 0, -1, 1),
    }  # fmt: skip
    bands = {f"sh{d}": table.sh[:, d * d : (d + 1) ** 2] for d in range(1, table.degree + 1)}
    values |= {name: band.reshape(len(table), -1) for name, band in bands.items()}
    found = {}
    for name, each in values.items():
        if labels is not None and name in bands:
            continue
        least, most = RANGES.get(name, RANGES["sh"])
        if encodings[name] == "oct88r8":
            found[name] = (octahedral(table.quats), "oct88r8", 0.0, 1.0)
        else:
            found[name] = (
                encoded(each, encodings[name], least, most),
                encodings[name],
                least,
                most,
            )
    return found


def chunk_of(
    columns: Mapping[str, tuple[bytes, str, float, float]], base: int, count: int
) -> bytes:
    properties, payload = [], b""
    for name, (data, encoding, least, most) in columns.items():
        packer = zlib.compressobj(6, wbits=-15)
        packed = packer.compress(data) + packer.flush()
        about: dict[str, Any] = {"offset": len(payload), "bytes": len(packed), "property": name}
        about |= {"encoding": encoding, "compression": "gz", "min": least, "max": most}
        properties.append(about)
        payload += packed + bytes(-len(packed) % 8)
    meta = {"version": 1, "base": base, "count": count, "payloadBytes": len(payload)}
    return (
        framed(b"RADC", meta | {"properties": properties})
        + struct.pack("<Q", len(payload))
        + payload
    )


def framed(magic: bytes, meta: Mapping[str, Any]) -> bytes:
    data = json.dumps(meta).encode()
    return magic + struct.pack("<I", len(data)) + data + bytes(-len(data) % 8)


def rad(
    path: Path,
    table: SplatTable,
    encodings: Mapping[str, str] = USUAL,
    *,
    rows: int = 65536,
    children: np.ndarray | None = None,
    labels: np.ndarray | None = None,
    beside: bool = False,
) -> Path:
    """Write a scene in chunks of `rows`; `children` says how many each row of a tree has.

    `labels`: row r has the SH of row labels[r], and each row's own are the codes of the palette.
    `beside`: each chunk becomes a file of its own.
    """
    chunks = []
    for base in range(0, len(table), rows):
        part = table[base : base + rows]
        columns = columns_of(part, encodings, labels)
        if labels is not None:
            if base == 0:
                codes = columns_of(table, encodings, None)
                columns |= {f"{n}_code": each for n, each in codes.items() if n.startswith("sh")}
            own = labels[base : base + rows, None]
            columns["sh_label"] = (encoded(own, "u16", 0, 1), "u16", 0.0, 1.0)
        if children is not None:
            own = children[base : base + rows, None]
            columns["child_count"] = (encoded(own, "u16", 0, 1), "u16", 0.0, 1.0)
            columns["child_start"] = (encoded(0 * own, "u32", 0, 1), "u32", 0.0, 1.0)
        chunks.append(chunk_of(columns, base, len(part)))
    places, at = [], 0
    for index, chunk in enumerate(chunks):
        name = {"filename": f"{path.stem}-{index}.radc"} if beside else {}
        places.append({"offset": 0 if beside else at, "bytes": len(chunk), **name})
        at += len(chunk)
        if beside:
            (path.parent / name["filename"]).write_bytes(chunk)
    meta = {"version": 1, "type": "gsplat", "count": len(table), "maxSh": table.degree,
            "chunkSize": rows, "allChunkBytes": at, "chunks": places}  # fmt: skip
    meta |= {"lodTree": True} if children is not None else {}
    path.write_bytes(framed(b"RAD0", meta) + (b"" if beside else b"".join(chunks)))
    return path
