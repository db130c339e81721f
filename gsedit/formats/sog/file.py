"""PlayCanvas' .sog: versions 1 and 2 in (a zip, or meta.json with its pictures), 2 out (a zip).

Every value is a byte or two of a pixel of lossless WebP pictures: positions in 16 bits along a
logarithm, rotations as smallest three, scales, colors and SH through codebooks of 256 numbers, SH
through a palette before. Reading holds the pictures (24 bytes a Gaussian) and one block; writing
holds the scene, whose order changes.
Source: developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from gsedit.errors import InputError
from gsedit.formats.limits import check_expansion
from gsedit.formats.quantised import from_smallest_three, logits_of
from gsedit.formats.sog.pictures import (
    ENTRIES_A_ROW,
    LARGEST_TAG,
    META,
    SogFiles,
    picture_size,
)
from gsedit.formats.streams import (
    AT_ONCE,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
    gather,
)
from gsedit.scene.table import SplatTable
from gsedit.storage.json_files import object_of, parse_json

META_MAX_BYTES = 1 << 20
_PALETTE_MAX = 1 << 16
_BYTES_A_ROW = 24
"""Bytes of the six pictures that have one pixel a Gaussian."""
_AGAIN = "export it again"


@dataclass(frozen=True, eq=False)
class _Scene:
    """Contents of a meta.json, checked."""

    version: int
    count: int
    antialiased: bool
    lows: Float64[np.ndarray, "3"]
    highs: Float64[np.ndarray, "3"]
    files: dict[str, list[str]]
    scales: Float32[np.ndarray, "256 3"]
    """The codebook of each axis."""
    colors: Float32[np.ndarray, "256 4"]
    """Those of red, green, blue and the logit of opacity."""
    degree: int = 0
    entries: int = 0
    """Entries of the SH palette."""
    sh: Float32[np.ndarray, "256"] | None = None


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .sog, or a meta.json. Raises InputError for one that cannot be right."""
    files = SogFiles(path)
    scene = _Meta(files).scene()
    names = [name for each in scene.files.values() for name in each]
    check_expansion(path, files.size(names), scene.count * _BYTES_A_ROW)
    return SceneSource(
        path,
        f"{'.sog' if files.zipped else 'SOG folder'} version {scene.version}",
        SceneHeader(scene.degree, antialiased=scene.antialiased),
        scene.count,
        partial(_blocks, files, scene),
    )


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write a zip of version 2, rows in Morton order; the number of rows."""
    from gsedit.formats.sog.encode import write_sog

    table = gather(blocks, header, 0)
    if len(table):
        write_sog(path, table, antialiased=header.antialiased)
    return len(table)


class _Meta:
    """Reads the values of a meta.json; each raises InputError where it is not what it should be."""

    def __init__(self, files: SogFiles) -> None:
        self.files, self.path = files, files.path
        data = files.read(META, META_MAX_BYTES)
        self.values = parse_json(data, f"{self.path}: {META}", object_of({}), advice=_AGAIN)

    def scene(self) -> _Scene:
        version = self.values.get("version", 1)
        if version not in (1, 2) or isinstance(version, bool):
            raise InputError(f"{self.path} is SOG version {version!r}: gsedit reads 1 and 2")
        means = self.part("means")
        if version == 2:
            count = self.checked("count", self.values.get("count"), int)
        else:
            count = self.checked("means.shape", (means.get("shape") or [None])[0], int)
        if not 0 <= count < 1 << 32:
            raise InputError(f"{self.path}: {META} announces {count} Gaussians: {_AGAIN}")
        scales, colors = (self.codes if version == 2 else self.ranges)("scales", "sh0")
        files = {"means": 2, "scales": 1, "quats": 1, "sh0": 1}
        files = {name: self.names(name, number) for name, number in files.items()}
        scene = _Scene(
            version,
            count,
            self.values.get("antialias") is True,
            self.numbers("means.mins", means.get("mins"), 3),
            self.numbers("means.maxs", means.get("maxs"), 3),
            files,
            scales,
            colors,
        )
        if self.values.get("shN") is None:
            return scene
        files["shN"] = self.names("shN", 2)
        degree, entries, codes = (self.palette_2 if version == 2 else self.palette_1)(files["shN"])
        return _Scene(**{**vars(scene), "degree": degree, "entries": entries, "sh": codes})

    def codes(self, *names: str) -> tuple[np.ndarray, np.ndarray]:
        """Version 2: one codebook for all axes, one for all colors; opacity as it is."""
        scales, colors = (self.codebook(name) for name in names)
        logits = logits_of(np.arange(256) / 255)
        channels = np.column_stack((colors, colors, colors, logits)).astype(np.float32)
        return np.tile(scales[:, None], 3), channels

    def ranges(self, *names: str) -> tuple[np.ndarray, np.ndarray]:
        """Version 1: even steps between an end and the other of each axis or channel."""
        steps = np.arange(256)[:, None] / 255
        ends = [
            [self.numbers(f"{name}.{key}", self.part(name).get(key), size) for key in _ENDS]
            for name, size in zip(names, (3, 4))
        ]
        scales, colors = (low + (high - low) * steps for low, high in ends)
        return scales.astype(np.float32), colors.astype(np.float32)

    def palette_2(self, names: list[str]) -> tuple[int, int, np.ndarray]:
        part = self.part("shN")
        degree = self.checked("shN.bands", part.get("bands"), int)
        entries = self.checked("shN.count", part.get("count"), int)
        if not (0 <= degree <= 3 and 0 < entries <= _PALETTE_MAX):
            raise InputError(f"{self.path}: shN of {degree} bands, {entries} entries: {_AGAIN}")
        return degree, entries, self.codebook("shN")

    def palette_1(self, names: list[str]) -> tuple[int, int, np.ndarray]:
        """Its size is that of its picture."""
        data = self.files.read(names[0], 32 * _PALETTE_MAX * 4)
        width, height = picture_size(data) or (0, 0)
        degree = {ENTRIES_A_ROW * ((d + 1) ** 2 - 1): d for d in (1, 2, 3)}.get(width, -1)
        if degree < 0 or height * ENTRIES_A_ROW > _PALETTE_MAX:
            raise InputError(f"{self.path}: {names[0]} is {width}x{height}: {_AGAIN}")
        part = self.part("shN")
        low, high = (self.numbers(f"shN.{key}", [part.get(key)], 1) for key in _ENDS)
        codes = low + (high - low) * np.arange(256) / 255
        return degree, height * ENTRIES_A_ROW, codes.astype(np.float32)

    def codebook(self, name: str) -> Float32[np.ndarray, "256"]:
        """At most 256 numbers, then NaN. A first one that is null, as early writers stored it, is
        where the others lead back to."""
        codes = self.checked(f"{name}.codebook", self.part(name).get("codebook"), list)
        if len(codes) == 256 and codes[0] is None:
            last, first = self.numbers(f"{name}.codebook", [codes[-1], codes[1]], 2)
            codes = [float(first + (first - last) / 255), *codes[1:]]
        if not 0 < len(codes) <= 256:
            raise InputError(f"{self.path}: {name}.codebook has {len(codes)} numbers: {_AGAIN}")
        known = self.numbers(f"{name}.codebook", codes, len(codes))
        return np.append(known, np.full(256 - len(codes), np.nan)).astype(np.float32)

    def names(self, name: str, number: int) -> list[str]:
        """The files of a property."""
        files = self.checked(f"{name}.files", self.part(name).get("files"), list)
        if len(files) != number or not all(isinstance(each, str) for each in files):
            raise InputError(f"{self.path}: {name}.files is not {number} names: {_AGAIN}")
        return files

    def part(self, name: str) -> dict[str, Any]:
        return self.checked(name, self.values.get(name), dict)

    def numbers(self, name: str, values: Any, size: int) -> Float64[np.ndarray, " n"]:
        values = self.checked(name, values, list)
        if len(values) != size or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and isfinite(v) and abs(v) < 1e30
            for v in values
        ):
            raise InputError(f"{self.path}: {name} is not {size} finite numbers: {_AGAIN}")
        return np.array(values, np.float64)

    def checked(self, name: str, value: Any, kind: type) -> Any:
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(f"{self.path}: {META} has no {name} ({kind.__name__}): {_AGAIN}")
        return value


_ENDS = ("mins", "maxs")


def _blocks(files: SogFiles, scene: _Scene) -> Blocks:
    if not scene.count:
        return

    def pixels(name: str, number: int = 0) -> UInt8[np.ndarray, "n 4"]:
        return files.pixels(scene.files[name][number], scene.count)

    low, high, scales = pixels("means", 0), pixels("means", 1), pixels("scales")
    quats, colors = pixels("quats"), pixels("sh0")
    palette = _palette(files, scene) if scene.degree else None
    labels = pixels("shN", 1)[:, :2].copy() if palette is not None else None
    for start in range(0, scene.count, AT_ONCE):
        rows = slice(start, start + AT_ONCE)
        color = _looked_up(files, "sh0", scene.colors, colors[rows])
        sh = color[:, None, :3]
        if palette is not None and labels is not None:
            entry = labels[rows].view("<u2")[:, 0]
            if entry.max() >= len(palette):
                raise InputError(
                    f"{files.path}: a row has SH entry {entry.max()} of {len(palette)}: {_AGAIN}"
                )
            sh = np.concatenate((sh, palette[entry]), 1)
        yield SplatTable(
            _means(low[rows], high[rows], scene),
            _quats(quats[rows]),
            _looked_up(files, "scales", scene.scales, scales[rows]),
            color[:, 3],
            sh,
        )


def _means(
    low: UInt8[np.ndarray, "n 4"], high: UInt8[np.ndarray, "n 4"], scene: _Scene
) -> Float32[np.ndarray, "n 3"]:
    steps = low[:, :3] + high[:, :3].astype(np.float64) * 256
    logs = scene.lows + (scene.highs - scene.lows) * (steps / 65535)
    with np.errstate(over="ignore", invalid="ignore"):  # such rows are found later
        return (np.sign(logs) * np.expm1(np.abs(logs))).astype(np.float32)


def _quats(pixels: UInt8[np.ndarray, "n 4"]) -> Float32[np.ndarray, "n 4"]:
    """wxyz; zero, which is found later, where a pixel does not say which component is missing."""
    others = (pixels[:, :3].astype(np.float32) / 255 * 2 - 1) * np.float32(0.5**0.5)
    known = pixels[:, 3] >= LARGEST_TAG
    largest = np.where(known, pixels[:, 3] - np.uint8(LARGEST_TAG), 0)
    return np.where(known[:, None], from_smallest_three(others, largest), np.float32(0))


def _looked_up(
    files: SogFiles,
    name: str,
    codes: Float32[np.ndarray, "256 m"],
    pixels: UInt8[np.ndarray, "n b"],
) -> Float32[np.ndarray, "n m"]:
    """Each channel through its codebook, which ends in NaN where it is short."""
    used = pixels[:, : codes.shape[1]].astype(np.intp)
    values = np.take_along_axis(codes, used, axis=0)
    if np.isnan(values).any():
        raise InputError(f"{files.path}: {name} points beyond the end of its codebook: {_AGAIN}")
    return values


def _palette(files: SogFiles, scene: _Scene) -> Float32[np.ndarray, "p k 3"]:
    """The SH coefficients of every entry."""
    assert scene.sh is not None
    coefficients = (scene.degree + 1) ** 2 - 1
    height = -(-scene.entries // ENTRIES_A_ROW)
    width = ENTRIES_A_ROW * coefficients
    picture = files.picture(scene.files["shN"][0], width * height)
    if picture.shape[1] != width:
        raise InputError(
            f"{files.path}: {scene.files['shN'][0]} is {picture.shape[1]} pixels wide, "
            f"degree {scene.degree} needs {width}: {_AGAIN}"
        )
    codes = picture[:height, :, :3].reshape(-1, coefficients, 3)[: scene.entries]
    flat = _looked_up(files, "shN", scene.sh[:, None], codes.reshape(-1, 1))
    return flat.reshape(codes.shape)
