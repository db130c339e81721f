"""The photos that a folder holds, in whatever folders a phone or several cameras left them."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gsedit.capture.frames import is_video
from gsedit.capture.stages import LOG
from gsedit.errors import InputError

PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".heic", ".heif", ".avif")
OTHER = re.compile(r"masks?|depths?|normals|thumbnails?|thumbs|@eadir")
"""Names of folders whose pictures are no photos (@eaDir: thumbnails of a network drive)."""
SMALLER = re.compile(r"(images|photos)_[0-9]+")
"""Names of folders that hold the photos made smaller, where the photos are in one beside them that
has no number (INRIA's trainer, nerfstudio)."""
RECORDS = ("capture.json", "make.json", "edit.json", LOG)
"""Files in the folders that gsedit writes; the last is there before a capture has a result."""
NAMED_FILES = 4
"""Folders that a message names."""


@dataclass(frozen=True)
class Found:
    """Contents of a folder of photos."""

    files: tuple[Path, ...]
    """Those that should be photos, in the order of their folders, then of their names: 2 before
    10."""
    notes: tuple[str, ...]
    """For a person: how many are in which folder, and what was left out."""


def find_photos(folder: Path, out: Path) -> Found:
    """The photos of a folder and of those in it, without `out`, where the capture goes.

    Left out besides, with a note: masks, smaller copies (images_2 beside images, ...), what gsedit
    made, and videos. Hidden folders are not looked into. Raises InputError where there is no photo.
    """
    if (folder / RECORDS[0]).is_file():
        raise InputError(
            f"{folder} is what gsedit capture wrote: name it for gsedit fit, or "
            f"{folder / 'images'} to pose its photos again"
        )
    found, videos, others = [], [], []
    for here, files in _walk(folder, {out.resolve()}, others):
        found += [here / name for name in files if Path(name).suffix.lower() in PICTURES]
        videos += [here / name for name in files if is_video(Path(name))]
    if not found:
        raise InputError(f"{folder} holds no photos{_instead(sorted(videos), sorted(others))}")
    found.sort(key=lambda path: _order(path.relative_to(folder)))
    notes = [_by_folder(found)] if {each.parent for each in found} != {folder} else []
    if others:
        parts = [f"{each} ({counted(_pictures(each), 'picture')})" for each in sorted(others)]
        notes.append(
            f"left out: {_some(parts)}: by name or content masks, smaller copies, results of "
            "gsedit, or links out of the folder; name one itself if it holds photos"
        )
    if videos:
        notes.append(f"left out: {counted(len(videos), 'video')} ({min(videos)}): name one itself")
    return Found(tuple(found), tuple(notes))


def _walk(folder: Path, seen: set[Path], others: list[Path]) -> Iterator[tuple[Path, list[str]]]:
    """The folders and their files, nothing hidden, no folder twice; those that hold pictures that
    are no photos of their own, and links to folders elsewhere, go to `others`."""

    def refuse(error: OSError) -> None:
        raise InputError(
            f"{error.filename} cannot be read ({error.strerror}): change its "
            "permissions, or move the photos into another folder"
        )

    top = folder.resolve()
    for place, inner, files in os.walk(folder, onerror=refuse, followlinks=True):
        here = Path(place)
        real = here.resolve()
        if real in seen or not real.is_relative_to(top):
            inner.clear()
            if real not in seen and _pictures(here):
                others.append(here)
            continue
        seen.add(real)
        made = any(record in files for record in RECORDS)
        if here != folder and (made or _is_other(here)):
            inner.clear()
            if _pictures(here):
                others.append(here)
            continue
        inner[:] = (name for name in inner if name[0] != ".")
        yield here, [name for name in files if name[0] != "."]


def _is_other(folder: Path) -> bool:
    """Whether a folder holds pictures that are no photos of their own, by its name."""
    smaller = SMALLER.fullmatch(folder.name.lower())
    if smaller is None:
        return OTHER.fullmatch(folder.name.lower()) is not None
    return folder.with_name(folder.name[: smaller.end(1)]).is_dir()


def _pictures(folder: Path) -> int:
    return sum(each.suffix.lower() in PICTURES for each in folder.rglob("*"))


def counted(number: int, what: str) -> str:
    """A number of things, in words: no photos, 1 photo, 2 photos."""
    return f"{number or 'no'} {what}" + "s" * (number != 1)


def _instead(videos: Sequence[Path], others: Sequence[Path]) -> str:
    if videos:
        return f" but a video: name {videos[0]} itself"
    if others:
        return f" but in {others[0]}: name it itself"
    return f" ({', '.join(PICTURES[:6])}): check the folder"


def _by_folder(files: Sequence[Path]) -> str:
    counts = Counter(each.parent for each in files)
    parts = [f"{count} in {place}" for place, count in counts.items()]
    if len(parts) == 1:
        return f"{counted(len(files), 'photo')} in {files[0].parent}"
    return f"{len(files)} photos of {len(counts)} folders: {_some(parts)}"


def _some(parts: Sequence[str]) -> str:
    more = len(parts) - NAMED_FILES
    return ", ".join(parts[:NAMED_FILES]) + (f", and {more} more" if more > 0 else "")


def _order(path: Path) -> tuple[list[list[tuple[int, str]]], list[tuple[int, str]], str]:
    return [natural(part) for part in path.parts[:-1]], natural(path.name), str(path)


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts numbers within names by their value."""
    parts = re.findall(r"\d+|\D+", name.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]
