"""The files of a SOG scene, in a folder or a zip, and its pictures: checked before they are read.

A scene may come from anybody: it may name its own files only, and their sizes are compared with
what the scene's count explains before memory is taken.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from gsedit.errors import InputError
from gsedit.formats.limits import check_expansion
from gsedit.storage.inputs import existing_file, file_inside
from gsedit.storage.safe_names import safe_name

META = "meta.json"
LARGEST_TAG = 252
"""Alpha of a rotation: this, plus the place of the largest component of wxyz."""
ENTRIES_A_ROW = 64
"""Entries in a row of the palette's picture; an entry has one pixel a coefficient."""
_AGAIN = "it is cut off or damaged, copy or export it again"
_BROKEN_ZIP = (
    zipfile.BadZipFile, zlib.error, struct.error,
    OSError, EOFError, RuntimeError, ValueError, NotImplementedError,
)  # fmt: skip
"""Errors that zipfile raises for damaged archives."""
_BROKEN_PICTURE = (OSError, EOFError, ValueError, SyntaxError, struct.error, zlib.error)
"""Errors that Pillow raises for damaged pictures."""
_SPARE = 1 << 16
"""Pixels that a picture may have above four times those that the scene needs."""


class SogFiles:
    """The files beside a meta.json, or of a zip with a meta.json in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.zipped = path.name.lower() != META
        self.prefix = ""
        """Of names in the zip: some archives hold one folder."""
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
                f"{self.path}: {name} is larger than its scene explains ({limit} bytes): {_AGAIN}"
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
                raise InputError(f"{self.path}: {name} ({error}): {_AGAIN}") from None

    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.path)
        except _BROKEN_ZIP as error:
            raise InputError(f"{self.path} is no readable zip ({error}): {_AGAIN}") from None

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
                f"{where} has {width}x{height} pixels, the scene needs {count}: {_AGAIN}"
            )
        if width * height > 4 * count + _SPARE:
            raise InputError(f"{where} has {width}x{height} pixels for {count} values: {_AGAIN}")
        check_expansion(self.path, len(data), 4 * width * height)
        try:
            with Image.open(io.BytesIO(data), formats=("WEBP", "PNG")) as image:
                if image.size != (width, height):
                    raise ValueError("its size is told twice")
                return np.asarray(image.convert("RGBA"))
        except (*_BROKEN_PICTURE, Image.DecompressionBombError) as error:
            raise InputError(f"{where} is no readable picture ({error}): {_AGAIN}") from None


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


def lossless_webp(pixels: UInt8[np.ndarray, "h w 4"]) -> bytes:
    """The picture with every value as it is, colors of transparent pixels too (`exact`)."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, exact=True, quality=75, method=4)
    return out.getvalue()
