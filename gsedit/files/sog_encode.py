"""A scene as the pictures and the meta.json of SOG version 2, in a zip."""

from __future__ import annotations

import json
import zipfile
from math import ceil, sqrt
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Shaped, UInt8

from gsedit.files.codebooks import codebook, nearest_codes, palette
from gsedit.files.morton import morton_order
from gsedit.files.sog_pictures import ENTRIES_A_ROW, LARGEST_TAG, META, OTHERS, lossless_webp
from gsedit.files.table import SplatTable

PALETTE = 1 << 16
"""Entries of the SH palette at most: a label has 16 bits. A scene of fewer rows gets the power of
two below their number, as PlayCanvas' writer gives it: a palette as large as the scene is no
saving."""
_LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""In the zip, so that equal scenes make equal files."""


def write_sog(path: Path, table: SplatTable, *, antialiased: bool) -> None:
    """Write a scene that is not empty. Raises nothing of its own."""
    table = table[morton_order(table.means)]
    with zipfile.ZipFile(path, "w") as archive:
        meta = {
            "version": 2,
            "asset": {"generator": "gsedit"},
            "count": len(table),
            "antialias": antialiased,
            "means": _means(archive, table.means),
            "scales": _scales(archive, table.log_scales),
            "quats": _quats(archive, table.quats),
            "sh0": _colors(archive, table),
        }
        if table.degree:
            meta["shN"] = _sh(archive, table)
        _store(archive, META, json.dumps(meta, separators=(",", ":")).encode())


def _means(archive: zipfile.ZipFile, means: Float32[np.ndarray, "n 3"]) -> dict[str, object]:
    logs = np.sign(means) * np.log1p(np.abs(means.astype(np.float64)))
    low, high = logs.min(0), logs.max(0)
    width = np.where(high > low, high - low, 1)
    steps = np.rint((logs - low) / width * 65535).astype(np.uint16)
    files = ["means_l.webp", "means_u.webp"]
    for name, part in zip(files, (steps & 255, steps >> 8)):
        _picture(archive, name, part.astype(np.uint8))
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": files}


def _quats(archive: zipfile.ZipFile, quats: Float32[np.ndarray, "n 4"]) -> dict[str, object]:
    unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    largest = np.abs(unit).argmax(1)
    rows = np.arange(len(unit))
    others = unit[rows[:, None], OTHERS[largest]] * np.sign(unit[rows, largest])[:, None]
    steps = np.rint((others * np.float32(2**0.5) / 2 + np.float32(0.5)) * 255).clip(0, 255)
    pixels = np.column_stack((steps, largest + LARGEST_TAG)).astype(np.uint8)
    _picture(archive, "quats.webp", pixels)
    return {"files": ["quats.webp"]}


def _scales(archive: zipfile.ZipFile, scales: Float32[np.ndarray, "n 3"]) -> dict[str, object]:
    codes = codebook(scales)
    _picture(archive, "scales.webp", nearest_codes(scales, codes))
    return {"codebook": codes.tolist(), "files": ["scales.webp"]}


def _colors(archive: zipfile.ZipFile, table: SplatTable) -> dict[str, object]:
    codes = codebook(table.sh[:, 0])
    alphas = np.rint(table.opacities * 255).clip(0, 255).astype(np.uint8)
    _picture(archive, "sh0.webp", np.column_stack((nearest_codes(table.sh[:, 0], codes), alphas)))
    return {"codebook": codes.tolist(), "files": ["sh0.webp"]}


def _sh(archive: zipfile.ZipFile, table: SplatTable) -> dict[str, object]:
    """Rows to entries of a palette, their coefficients to a codebook."""
    rows = np.ascontiguousarray(table.sh[:, 1:]).reshape(len(table), -1)
    entries = min(PALETTE, 1 << (len(table).bit_length() - 1))
    vectors, labels = palette(rows, entries)
    codes = codebook(vectors)
    height = ceil(len(vectors) / ENTRIES_A_ROW)
    values = np.zeros((height * ENTRIES_A_ROW, rows.shape[1]), np.uint8)
    values[: len(vectors)] = nearest_codes(vectors, codes)
    files = ["shN_centroids.webp", "shN_labels.webp"]
    _store(archive, files[0], lossless_webp(_opaque(values.reshape(height, -1, 3))))
    _picture(archive, files[1], np.column_stack((labels & 255, labels >> 8, 0 * labels)))
    about = {"count": len(vectors), "bands": table.degree}
    return {**about, "codebook": codes.tolist(), "files": files}


def _picture(archive: zipfile.ZipFile, name: str, values: Shaped[np.ndarray, "n c"]) -> None:
    """Store a pixel a row, in a picture that is nearly square."""
    width = ceil(sqrt(len(values)) / 4) * 4
    height = ceil(len(values) / width / 4) * 4
    pixels = np.zeros((height * width, values.shape[1]), np.uint8)
    pixels[: len(values)] = values
    _store(archive, name, lossless_webp(_opaque(pixels.reshape(height, width, -1))))


def _opaque(pixels: UInt8[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h w 4"]:
    """RGB with an alpha of 255; RGBA as it is."""
    if pixels.shape[2] == 4:
        return pixels
    alpha = np.full((*pixels.shape[:2], 1), 255, np.uint8)
    return np.concatenate((pixels, alpha), 2)


def _store(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Not compressed: the pictures are already."""
    archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), data)
