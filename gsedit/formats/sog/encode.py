"""Values that share few: codebooks of numbers, palettes of vectors. numpy, deterministic.

`n` values or rows, `k` entries, `d` numbers a row.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int32, Shaped, UInt8

from gsedit.formats.quantised import smallest_three
from gsedit.scene.neighbors import morton_order
from gsedit.scene.table import SplatTable

META = "meta.json"
LARGEST_TAG = 252
"""Alpha of a rotation: this, plus the place of the largest component of wxyz."""
ENTRIES_A_ROW = 64
"""Entries in a row of the palette's picture; an entry has one pixel a coefficient."""
CODES = 256
"""Entries of a codebook: an index is one byte."""
_BINS = 1 << 16
"""Bins of the histogram that stands for the values."""
_COARSE = 1 << 10
"""Bins of the coarse histogram, which tells how many values are near."""


def codebook(values: Shaped[np.ndarray, "..."]) -> Float32[np.ndarray, "256"]:
    """256 numbers, ascending, with about the least sum of squared errors to the values, where a
    value counts the less the more there are near it: together as the cube root of their number.

    Few values are far out, but they are the largest Gaussians: codes for the many alone lost 10 dB
    in some views of the bear. Lloyd's iteration on a histogram; from quantiles of the cube root of
    the weights, which is how the best quantiser of many steps lies (Panter and Dite, 1951).
    """
    low, high = float(values.min()), float(values.max())
    if low == high:
        return np.full(CODES, low, np.float32)
    values = values.astype(np.float64)  # float32 has too few steps for the bins of a narrow range
    counts, edges = np.histogram(values, _BINS, (low, high))
    sums, _ = np.histogram(values, _BINS, (low, high), weights=values)
    centers = (edges[:-1] + edges[1:]) / 2
    near = counts.reshape(_COARSE, -1).sum(1)
    weights = np.repeat(np.maximum(near, 1) ** (-2 / 3), _BINS // _COARSE)
    share = np.cumsum(np.cbrt(np.cbrt(near)))
    ends = edges[_BINS // _COARSE :: _BINS // _COARSE]
    codes = np.interp((np.arange(CODES) + 0.5) / CODES * share[-1], share, ends)
    number = np.concatenate(([0], np.cumsum(counts * weights)))
    total = np.concatenate(([0], np.cumsum(sums * weights)))
    for _ in range(50):  # of Lloyd's iteration; later rounds move little
        borders = np.searchsorted(centers, (codes[:-1] + codes[1:]) / 2)
        borders = np.concatenate(([0], borders, [_BINS]))
        own = np.diff(number[borders])
        means = np.diff(total[borders]) / np.where(own > 0, own, 1)
        codes = np.sort(np.where(own > 0, means, codes))
    return codes.astype(np.float32)


def nearest_codes(
    values: Float32[np.ndarray, "..."], codes: Float32[np.ndarray, "256"]
) -> Shaped[np.ndarray, "..."]:
    """The index of the nearest of ascending codes, one byte each."""
    return np.searchsorted((codes[:-1] + codes[1:]) / 2, values).astype(np.uint8)


def palette(
    rows: Float32[np.ndarray, "n d"], entries: int
) -> tuple[Float32[np.ndarray, "k d"], Int32[np.ndarray, " n"]]:
    """At most `entries` vectors that stand for the rows, and which one does for each row.

    Groups are cut in two at the mean of their column of largest variance, those of the largest
    squared error first, the worse half of them at a time (median cut, Heckbert 1982, by variance).
    O(n d) a round, about 30 rounds: k-means would compare every row with every entry.
    """
    order = np.arange(len(rows))
    groups = _Groups.of(rows, np.zeros(1, np.int64))
    while len(groups.starts) < entries and groups.errors.max() > 0:
        room = min(entries - len(groups.starts), max(1, len(groups.starts) // 2))
        chosen = np.sort(np.argsort(-groups.errors, kind="stable")[:room])
        groups = groups.cut(rows, order, chosen[groups.errors[chosen] > 0])
    sizes = np.diff(np.append(groups.starts, len(rows)))
    labels = np.empty(len(rows), np.int32)
    labels[order] = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    sums = np.add.reduceat(rows[order], groups.starts, axis=0, dtype=np.float64)
    return (sums / sizes[:, None]).astype(np.float32), labels


@dataclass(frozen=True, eq=False)
class _Groups:
    """Runs of rows in some order."""

    starts: Shaped[np.ndarray, " g"]
    """First row of each group, ascending from 0."""
    errors: Shaped[np.ndarray, " g"]
    """Sums of squared distances to the mean; 0 where no cut makes two groups."""
    columns: Shaped[np.ndarray, " g"]
    """Column of the largest variance in each group."""
    means: Shaped[np.ndarray, " g"]
    """Mean of that column in each group."""

    @staticmethod
    def of(rows: Float32[np.ndarray, "n d"], starts: Shaped[np.ndarray, " g"]) -> _Groups:
        """Statistics of rows that are in the order of the groups."""
        sizes = np.diff(np.append(starts, len(rows)))[:, None]
        means = np.add.reduceat(rows, starts, axis=0, dtype=np.float64) / sizes
        squares = np.add.reduceat(np.square(rows, dtype=np.float32), starts, 0, np.float64)
        spread = (squares - sizes * means**2).clip(0)
        columns = spread.argmax(1)
        here = np.arange(len(starts)), columns
        return _Groups(starts, spread.sum(1), columns, means[here])

    def cut(
        self, rows: Float32[np.ndarray, "n d"], order: np.ndarray, chosen: np.ndarray
    ) -> _Groups:
        """All groups, the chosen ones in two; sorts their part of `order`."""
        first = self.starts[chosen]
        sizes = np.append(self.starts, len(rows))[chosen + 1] - first
        group = np.repeat(np.arange(len(chosen)), sizes)
        offsets = np.cumsum(sizes) - sizes
        places = np.arange(len(group)) + (first - offsets)[group]
        members = order[places]
        upper = rows[members, self.columns[chosen][group]] > self.means[chosen][group]
        members = members[np.argsort(2 * group + upper, kind="stable")]
        order[places] = members
        lower = sizes - np.bincount(group, upper, len(chosen)).astype(np.int64)
        whole = (lower == 0) | (lower == sizes)  # rows that differ by rounding only
        errors = self.errors.copy()
        errors[chosen[whole]] = 0
        keep = np.ones(len(self.starts), bool)
        keep[chosen[~whole]] = False
        halves = np.stack((offsets, offsets + lower), 1)
        inside = np.unique(halves[halves < len(members)].ravel())
        made = _Groups.of(rows[members], inside)
        fresh = np.repeat(~whole, sizes)[inside]
        starts = places[inside]
        parts = (
            np.concatenate((old[keep], new[fresh]))
            for old, new in (
                (self.starts, starts),
                (errors, made.errors),
                (self.columns, made.columns),
                (self.means, made.means),
            )
        )
        starts, errors, columns, means = parts
        sort = np.argsort(starts)
        return _Groups(starts[sort], errors[sort], columns[sort], means[sort])


PALETTE = 1 << 16
"""Entries of the SH palette at most: a label has 16 bits. A scene of fewer rows gets the power of
two below their number, as PlayCanvas' writer gives it: a palette as large as the scene is no
saving."""
_LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""In the zip, so that equal scenes make equal files."""


Store = Callable[[str, bytes], None]
"""Receives a file of a scene: its name and its bytes."""


def write_sog(path: Path, table: SplatTable, *, antialiased: bool) -> None:
    """Write a scene that is not empty as a zip, in Morton order. Raises nothing of its own."""
    with zipfile.ZipFile(path, "w") as archive:  # not compressed: the pictures are already

        def store(name: str, data: bytes) -> None:
            archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), data)

        table = table[morton_order(table.means)]
        meta = {
            "version": 2,
            "asset": {"generator": "gsedit"},
            "count": len(table),
            "antialias": antialiased,
            "means": _means(store, table.means),
            "scales": _scales(store, table.log_scales),
            "quats": _quats(store, table.quats),
            "sh0": _colors(store, table),
        }
        if table.degree:
            meta["shN"] = _sh(store, table)
        store(META, json.dumps(meta, separators=(",", ":")).encode())


def _means(store: Store, means: Float32[np.ndarray, "n 3"]) -> dict[str, object]:
    logs = np.sign(means) * np.log1p(np.abs(means.astype(np.float64)))
    low, high = logs.min(0), logs.max(0)
    width = np.where(high > low, high - low, 1)
    steps = np.rint((logs - low) / width * 65535).astype(np.uint16)
    files = ["means_l.webp", "means_u.webp"]
    for name, part in zip(files, (steps & 255, steps >> 8)):
        _picture(store, name, part.astype(np.uint8))
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": files}


def _quats(store: Store, quats: Float32[np.ndarray, "n 4"]) -> dict[str, object]:
    others, largest = smallest_three(quats)
    steps = np.rint((others * np.float32(2**0.5) / 2 + np.float32(0.5)) * 255).clip(0, 255)
    pixels = np.column_stack((steps, largest + LARGEST_TAG)).astype(np.uint8)
    _picture(store, "quats.webp", pixels)
    return {"files": ["quats.webp"]}


def _scales(store: Store, scales: Float32[np.ndarray, "n 3"]) -> dict[str, object]:
    codes = codebook(scales)
    _picture(store, "scales.webp", nearest_codes(scales, codes))
    return {"codebook": codes.tolist(), "files": ["scales.webp"]}


def _colors(store: Store, table: SplatTable) -> dict[str, object]:
    codes = codebook(table.sh[:, 0])
    alphas = np.rint(table.opacities * 255).clip(0, 255).astype(np.uint8)
    _picture(store, "sh0.webp", np.column_stack((nearest_codes(table.sh[:, 0], codes), alphas)))
    return {"codebook": codes.tolist(), "files": ["sh0.webp"]}


def _sh(store: Store, table: SplatTable) -> dict[str, object]:
    """Rows to entries of a palette, their coefficients to a codebook."""
    rows = np.ascontiguousarray(table.sh[:, 1:]).reshape(len(table), -1)
    entries = min(PALETTE, 1 << (len(table).bit_length() - 1))
    vectors, labels = palette(rows, entries)
    codes = codebook(vectors)
    height = ceil(len(vectors) / ENTRIES_A_ROW)
    values = np.zeros((height * ENTRIES_A_ROW, rows.shape[1]), np.uint8)
    values[: len(vectors)] = nearest_codes(vectors, codes)
    files = ["shN_centroids.webp", "shN_labels.webp"]
    store(files[0], lossless_webp(_opaque(values.reshape(height, -1, 3))))
    _picture(store, files[1], np.column_stack((labels & 255, labels >> 8, 0 * labels)))
    about = {"count": len(vectors), "bands": table.degree}
    return {**about, "codebook": codes.tolist(), "files": files}


def _picture(store: Store, name: str, values: Shaped[np.ndarray, "n c"]) -> None:
    """Store a pixel a row, in a picture that is nearly square."""
    width = ceil(sqrt(len(values)) / 4) * 4
    height = ceil(len(values) / width / 4) * 4
    pixels = np.zeros((height * width, values.shape[1]), np.uint8)
    pixels[: len(values)] = values
    store(name, lossless_webp(_opaque(pixels.reshape(height, width, -1))))


def _opaque(pixels: UInt8[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h w 4"]:
    """RGB with an alpha of 255; RGBA as it is."""
    if pixels.shape[2] == 4:
        return pixels
    alpha = np.full((*pixels.shape[:2], 1), 255, np.uint8)
    return np.concatenate((pixels, alpha), 2)


def lossless_webp(pixels: UInt8[np.ndarray, "h w 4"]) -> bytes:
    """The picture with every value as it is, colors of transparent pixels too (`exact`)."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, exact=True, quality=75, method=4)
    return out.getvalue()
