"""PlayCanvas' .sog of version 2: in a zip, or meta.json with its pictures; out a zip.

Every value is a byte or two of a pixel of lossless WebP pictures: positions in 16 bits along a
logarithm, rotations as smallest three, scales, colors and SH through codebooks of 256 numbers, SH
through a palette before. Reading holds the pictures (24 bytes a Gaussian) and one block; writing
holds the scene, whose order changes.
Source: developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from gsedit.errors import InputError
from gsedit.formats.limits import check_expansion
from gsedit.formats.quantised import from_smallest_three, logits_of
from gsedit.formats.sog.encode import ENTRIES_A_ROW, LARGEST_TAG, META, write_sog
from gsedit.formats.streams import AT_ONCE, Blocks, ReadOptions, SceneHeader, SceneSource, gather
from gsedit.run.inputs import existing_file, file_inside, safe_name
from gsedit.run.json_files import (
    Check,
    Misfit,
    checked,
    list_of,
    number,
    numbers,
    object_of,
    parse_json,
    text,
)
from gsedit.scene.table import SplatTable

_CUT = "it is cut off or damaged, copy or export it again"
_BROKEN_ZIP = (
    zipfile.BadZipFile, zlib.error, struct.error,
    OSError, EOFError, RuntimeError, ValueError, NotImplementedError,
)  # fmt: skip
"""Errors that zipfile raises for damaged archives."""
_BROKEN_PICTURE = (OSError, EOFError, ValueError, SyntaxError, struct.error, zlib.error)
"""Errors that Pillow raises for damaged pictures."""
_SPARE = 1 << 16
"""Pixels that a picture may have above four times those that the scene needs."""
_AGAIN = "export it again"
_NAMES = ("means", "scales", "quats", "sh0", "shN")


@dataclass(frozen=True, eq=False)
class _Scene:
    """Contents of a meta.json, checked."""

    count: int
    antialiased: bool
    lows: Float64[np.ndarray, "3"]
    highs: Float64[np.ndarray, "3"]
    files: dict[str, list[str]]
    scales: Float32[np.ndarray, "256 3"]
    """The codebook of each axis."""
    colors: Float32[np.ndarray, "256 4"]
    """Those of red, green, blue and the logit of opacity."""
    degree: int
    entries: int
    """Entries of the SH palette."""
    sh: Float32[np.ndarray, "256"] | None


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .sog, or a meta.json. Raises InputError for one that cannot be right."""
    files = SogFiles(path)
    scene = _scene(files)
    names = [name for each in scene.files.values() for name in each]
    check_expansion(path, files.size(names), scene.count * 24)  # six pictures of 4 bytes
    return SceneSource(
        path,
        ".sog" if files.zipped else "SOG folder",
        SceneHeader(scene.degree, antialiased=scene.antialiased),
        scene.count,
        partial(_blocks, files, scene),
    )


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write a zip of version 2, rows in Morton order; the number of rows."""
    table = gather(blocks, header, 0)
    if len(table):
        write_sog(path, table, antialiased=header.antialiased)
    return len(table)


def _codebook(value: Any, place: str) -> Float32[np.ndarray, "256"]:
    """At most 256 numbers, then NaN. A first one that is null, as early writers stored it, is where
    the others lead back to."""
    codes = list(value) if isinstance(value, list) else []
    if len(codes) == 256 and codes[0] is None:
        last, first = numbers(2, most=_MOST)([codes[-1], codes[1]], place).tolist()
        codes[0] = first + (first - last) / 255
    if not 0 < len(codes) <= 256:
        raise Misfit(f"{place} has {len(codes)} numbers")
    known = numbers(len(codes), most=_MOST)(codes, place)
    return np.append(known, np.full(256 - len(codes), np.nan)).astype(np.float32)


def _property(files: int, **needed: Check) -> Check:
    """A property that is stored in so many pictures."""
    return object_of({**needed, "files": list_of(text(), files, files)})


_MOST = 1e30
_META = object_of(
    {
        "count": number(0, (1 << 32) - 1, whole=True),
        "means": _property(2, **dict.fromkeys(("mins", "maxs"), numbers(3, most=_MOST))),
        "scales": _property(1, codebook=_codebook),
        "quats": _property(1),
        "sh0": _property(1, codebook=_codebook),
    },
    {
        "shN": _property(
            2,
            bands=number(0, 3, whole=True),
            count=number(1, 1 << 16, whole=True),
            codebook=_codebook,
        )
    },
)


def _scene(files: SogFiles) -> _Scene:
    """The contents of the meta.json. Raises InputError where they are not what they should be."""
    where = f"{files.path}: {META}"
    meta = parse_json(files.read(META, 1 << 20), where, object_of({}), advice=_AGAIN)
    if (version := meta.get("version", 1)) != 2:
        raise InputError(
            f"{files.path} is SOG version {str(version)[:20]}: gsedit reads 2, {_AGAIN}"
        )
    meta = checked(meta, _META, where, advice=_AGAIN)
    codes = meta["sh0"]["codebook"]
    channels = np.column_stack((codes, codes, codes, logits_of(np.arange(256) / 255)))
    sh = meta.get("shN", {"bands": 0, "count": 0, "codebook": None})
    return _Scene(
        meta["count"],
        meta.get("antialias") is True,
        meta["means"]["mins"],
        meta["means"]["maxs"],
        {name: meta[name]["files"] for name in _NAMES if name in meta},
        np.tile(meta["scales"]["codebook"][:, None], 3),
        channels.astype(np.float32),
        sh["bands"],
        sh["count"],
        sh["codebook"],
    )


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


class SogFiles:
    """The files beside a meta.json, or of a zip with a meta.json in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.zipped = path.name.lower() != META
        self.prefix = ""
        """Folder before the names in the zip, where an archive holds one; else empty."""
        if self.zipped:
            names = [info.filename for info in self._archive().infolist()]
            metas = [name for name in names if name.rpartition("/")[2] == META]
            if not metas:
                raise InputError(f"{path} is a zip without {META}: export it again as .sog")
            self.prefix = min(metas, key=len).removesuffix(META)

    def read(self, name: str, limit: int) -> bytes:
        """The bytes of a file. Raises InputError where it is missing, elsewhere or too large."""
        name = safe_name(name, str(self.path))
        data = self._unzipped(name, limit) if self.zipped else self._beside(name, limit)
        if len(data) > limit:
            raise InputError(
                f"{self.path}: {name} is larger than its scene explains ({limit} bytes): {_CUT}"
            )
        return data

    def size(self, names: list[str]) -> int:
        """Bytes of the zip, or of the files together."""
        if self.zipped:
            return self.path.stat().st_size
        return sum(self._file(name).stat().st_size for name in names)

    def _file(self, name: str) -> Path:
        """A file beside the meta.json, which is there."""
        name = safe_name(name, str(self.path))
        try:
            return existing_file(file_inside(self.path.parent, name, str(self.path)))
        except InputError as error:
            raise InputError(f"{self.path} names a file: {error}") from None

    def _beside(self, name: str, limit: int) -> bytes:
        with self._file(name).open("rb") as handle:
            return handle.read(limit + 1)

    def _unzipped(self, name: str, limit: int) -> bytes:
        with self._archive() as archive:
            try:
                info = archive.getinfo(self.prefix + name)
            except KeyError:
                raise InputError(f"{self.path} has no {name} in it: export it again") from None
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError(f"{self.path}: {name} is packed in a rare way: zip it again")
            try:
                with archive.open(info) as handle:
                    return handle.read(limit + 1)
            except _BROKEN_ZIP as error:
                raise InputError(f"{self.path}: {name} ({error}): {_CUT}") from None

    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.path)
        except _BROKEN_ZIP as error:
            raise InputError(f"{self.path} is no readable zip ({error}): {_CUT}") from None

    def pixels(self, name: str, count: int) -> UInt8[np.ndarray, "n 4"]:
        """The first `count` pixels of a picture (WebP or PNG), RGBA, row after row."""
        picture = self.picture(name, count)
        return picture.reshape(-1, 4)[:count]

    def picture(self, name: str, count: int) -> UInt8[np.ndarray, "h w 4"]:
        """A picture of `count` pixels, or some more at its end."""
        from PIL import Image

        data = self.read(name, 8 * count + (1 << 20))  # lossless takes 4 bytes a pixel at most
        where = f"{self.path}: {name}"
        width, height = picture_size(data) or (0, 0)
        if width * height < count:
            raise InputError(
                f"{where} has {width}x{height} pixels, the scene needs {count}: {_CUT}"
            )
        if width * height > 4 * count + _SPARE:
            raise InputError(f"{where} has {width}x{height} pixels for {count} values: {_CUT}")
        check_expansion(self.path, len(data), 4 * width * height)
        try:
            with Image.open(io.BytesIO(data), formats=("WEBP", "PNG")) as image:
                if image.size != (width, height):
                    raise ValueError("its size is told twice")
                return np.asarray(image.convert("RGBA"))
        except (*_BROKEN_PICTURE, Image.DecompressionBombError) as error:
            raise InputError(f"{where} is no readable picture ({error}): {_CUT}") from None


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Width and height from the header of a WebP or PNG; None for anything else.

    Before Pillow sees it: its WebP decoder takes memory for the whole picture when it opens one.
    Source: developers.google.com/speed/webp/docs/riff_container.
    """
    kind = data[12:16]
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        return struct.unpack(">II", data[16:24])
    if data[:4] != b"RIFF" or data[8:12] != b"WEBP" or len(data) < 30:
        return None
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        sizes = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        return tuple(sizes)  # pyright: ignore[reportReturnType]
    if kind == b"VP8 ":
        width, height = struct.unpack("<HH", data[26:30])
        return width & 0x3FFF, height & 0x3FFF
    return None
