"""The photos of a folder as the later stages need them: upright, 8-bit RGB, of a size that pays."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from gsedit.capture.stages import Step
from gsedit.errors import InputError
from gsedit.formats.pictures import decoded
from gsedit.run.json_files import read_json

HEIC = "HEIC needs pi-heif, which this machine lacks: pip install pi-heif, or convert them to JPEG"
QUALITY = 95
"""Quality of JPEG files that are written anew."""
SMALLEST = 64
"""Pixels of the shorter side: SIFT finds next to nothing in less."""
LONGEST = 200
"""Bytes of a name without its suffix: file systems take 255 with it."""
THUMBNAIL = 32
"""Pixels on a side, for comparing photos."""


@dataclass(frozen=True)
class Photo:
    """A photo that can be used."""

    source: str
    """Path of the user's file."""
    name: str
    """Name of the prepared file, without characters that COLMAP's list of pairs cannot hold."""
    width: int
    """Width of the prepared file, pixels."""
    height: int
    contrast: float
    """Standard deviation of the grey values, 0 to 255."""
    change: float
    """Largest difference from the first photo's thumbnail, grey values, 0 to 255."""


@dataclass(frozen=True)
class Prepared:
    """The prepared photos, and what was left out."""

    photos: tuple[Photo, ...]
    unreadable: tuple[str, ...]
    """"NAME (reason)" of each file that is no usable photo."""

    @staticmethod
    def load(path: Path) -> Prepared:
        record = read_json(path, advice="remove it")
        return Prepared(tuple(Photo(**each) for each in record["photos"]),
                        tuple(record["unreadable"]))  # fmt: skip


@cache
def register_heif() -> bool:
    """Let Pillow open .heic files in this process; whether it can. Their pixels and sizes come as
    they are shown, their EXIF orientation as 1; the info `original_orientation` keeps it."""
    try:
        import pi_heif
    except (ImportError, OSError):
        return False
    pi_heif.register_heif_opener()
    return True


def state_of(files: Sequence[Path]) -> list[tuple[str, int, int]]:
    """Fingerprint of files: name, bytes, time of the last change; zeros for a link to a missing
    file."""
    return [(str(each), *_stat(each)) for each in files]


def _stat(file: Path) -> tuple[int, int]:
    try:
        stat = file.stat()
    except OSError:
        return 0, 0
    return stat.st_size, stat.st_mtime_ns


def prepare(files: Sequence[Path], folder: Path, size: int, top: Path) -> Iterator[Step | Prepared]:
    """Write the photos into `folder`, with the longer side at most `size` pixels; yields steps,
    then what came out. A photo that is fine as it is gets a link or a copy. `top`: the folder that
    all are in; the folders between it and a photo are part of the photo's new name.

    Raises OSError where a photo cannot be written; one that cannot be read is left out.
    """
    folder.mkdir(parents=True)
    register_heif()
    photos: list[Photo] = []
    unreadable: list[str] = []
    first: np.ndarray | None = None
    taken: set[str] = set()
    for i, file in enumerate(files):
        yield Step(i, len(files))
        try:
            picture, fine, suffix = _read(file, size)
        except MemoryError:
            raise
        except Exception as error:  # Pillow's decoders raise a dozen kinds
            unreadable.append(f"{_inside(file, top)} ({_reason(file, error)})")
            continue
        name = _name(_inside(file, top), suffix, taken)
        if fine:
            _link(file, folder / name)
        else:
            # no EXIF: its orientation is applied, and COLMAP gets the focal length from us
            picture.save(folder / name, quality=QUALITY, subsampling=0)  # PNG ignores both
        grey = np.asarray(picture.convert("L").resize((THUMBNAIL, THUMBNAIL)), dtype=np.float32)
        first = grey if first is None else first
        change = float(np.abs(grey - first).max())
        contrast = float(np.asarray(picture.convert("L"), dtype=np.float32).std())
        photos.append(Photo(str(file), name, *picture.size, contrast, change))
    yield Step(len(files), len(files))
    yield Prepared(tuple(photos), tuple(unreadable))


def _read(file: Path, size: int) -> tuple[Image.Image, bool, str]:
    """The picture of one photo; whether its file is fine as it is; and the suffix to write."""
    with decoded(file) as opened:
        if getattr(opened, "n_frames", 1) > 1 and opened.format not in ("MPO", "TIFF", "HEIF"):
            raise ValueError("an animation: name the video it was made from")
        opened.load()
        plain = (
            opened.mode in ("RGB", "L")
            and opened.format in ("JPEG", "PNG")
            and opened.getexif().get(0x0112, 1) == 1
            and max(opened.size) <= size
        )
        suffix = ".png" if opened.format in ("PNG", "BMP") else ".jpg"
        upright = ImageOps.exif_transpose(opened)
    if min(upright.size) < SMALLEST:
        raise ValueError(f"{upright.width}x{upright.height} pixels, {SMALLEST} are needed")
    if plain:
        return upright.convert("RGB"), True, suffix
    picture = _rgb(upright)
    if max(picture.size) > size:
        scale = size / max(picture.size)
        width, height = (max(1, round(side * scale)) for side in picture.size)
        picture = picture.resize((width, height), Image.Resampling.LANCZOS, reducing_gap=3)
    return picture, False, suffix


def _rgb(picture: Image.Image) -> Image.Image:
    """8-bit RGB; transparent pixels are laid over white. 16 bits keep their levels: photos that are
    each stretched to their own brightest pixel do not fit together."""
    if picture.mode.startswith("I"):
        levels = np.asarray(picture).astype(np.float32) / 257
        return Image.fromarray(levels.round().clip(0, 255).astype(np.uint8)).convert("RGB")
    if picture.has_transparency_data:
        rgba = picture.convert("RGBA")
        white = Image.new("RGBA", rgba.size, "white")
        return Image.alpha_composite(white, rgba).convert("RGB")
    return picture.convert("RGB")


def _inside(file: Path, top: Path) -> Path:
    return file.relative_to(top) if file.is_relative_to(top) else Path(file.name)


def _name(file: Path, suffix: str, taken: set[str]) -> str:
    """The name with its folders and the suffix of what is written: unlike those taken, not too
    long, without spaces and #, which part and comment out the lines of COLMAP's list of pairs."""
    own = {".jpeg": ".jpg"}.get(file.suffix.lower(), file.suffix.lower())
    whole = os.fsencode("_".join((*file.parts[:-1], file.stem))).decode(errors="replace")
    # the end of a name tells more than its beginning: that is a folder's
    stem = re.sub(r"[\s#]+", "_", whole).encode()[-LONGEST:].decode(errors="ignore")
    name = stem + (file.suffix if own == suffix else suffix)
    if name.lower() in taken:
        name = f"{stem}_{file.suffix[1:]}{suffix}"
    number = 2
    while name.lower() in taken:
        name, number = f"{stem}_{number}{suffix}", number + 1
    taken.add(name.lower())
    return name


def _link(file: Path, place: Path) -> None:
    try:
        place.hardlink_to(file.resolve())
    except OSError:  # another disk, or a file system without links
        shutil.copyfile(file, place)


def _reason(file: Path, error: Exception) -> str:
    if file.suffix.lower() in (".heic", ".heif") and not register_heif():
        return "HEIC"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, InputError):
        return str(error).removeprefix(f"{file} ").partition(": ")[0]
    text = str(error).split("\n")[0].partition(" <_io.")[0]
    if "cannot identify image file" in text:
        return "no picture inside" if file.stat().st_size else "an empty file"
    return text or type(error).__name__
