"""Checks of an input before it is parsed: it exists, is not empty, lies in its folder; names in it
are relative paths inside a folder, or errors."""

from __future__ import annotations

import os
import re
import stat
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from gsedit.errors import InputError

_FLAGS = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)  # a pipe: do not wait for it


def existing_file(path: str | Path) -> Path:
    """The path of a file that exists and is not empty; otherwise InputError."""
    path = Path(path)
    with open_regular(path) as file:
        size = file.seek(0, os.SEEK_END)
    if size == 0:
        raise InputError(f"{path} is empty (0 bytes): copy or export it again")
    return path


def open_regular(path: Path) -> BinaryIO:
    """A file on a disk, opened for reading bytes. Raises InputError at once for anything else: a
    pipe or a device may never answer or never end."""
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder, not a file: name a file inside it")
        handle = os.open(path, os.O_RDONLY | _FLAGS)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check the path") from None
    except ValueError:  # a zero byte
        raise InputError(f"{str(path)!r} is no name of a file: check the path") from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise InputError(f"{path} is a pipe or a device, not a file: copy it into a file")
    return os.fdopen(handle, "rb")


def file_inside(folder: Path, relative: str, where: str) -> Path:
    """`folder / relative`, which must not leave the folder: not by `..`, a root, or a link; nor be
    longer than names are.

    A dataset may come from anybody, so it may name its own files only. `where` is the place that
    named the file, for the message. Raises InputError.
    """
    path = folder / relative
    try:
        path.exists()  # an error for a name that is too long
        stays = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of links; a zero byte in the name
        stays = False
    if not stays:
        raise InputError(
            f"{where}: {relative!r:.200} leaves the dataset folder {folder}, or is no name: "
            "copy the file into the folder and name it relative to it"
        )
    return path


def refuse_doubles(names: Iterable[str], what: str) -> None:
    """Raise InputError where a name occurs twice; `what` begins the message: "FILE: two frames"."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InputError(f"{what} are named {name!r:.200}: give each a name of its own")
        seen.add(name)


def beside(scene: Path, name: str) -> Path:
    """bear.NAME of bear.ply: a file that belongs to one scene of a folder."""
    packed = ".compressed.ply"
    stem = scene.name[: -len(packed)] if scene.name.lower().endswith(packed) else scene.stem
    return scene.with_name(f"{stem}.{name}")


LONGEST_PART_BYTES = 240
"""Longest folder or file of a name: endings such as .normals.png fit in 255 bytes with it."""
LONGEST_NAME_BYTES = 1024
"""Longest name, which leaves room for the folder before it."""
_FORBIDDEN_CATEGORIES = ("Cc", "Cs", "Zl", "Zp")
"""Unicode's control characters, halves of characters, and ends of lines."""
_DRIVE = re.compile(r"[A-Za-z]:")


def safe_name(name: str, where: str) -> str:
    """Return the relative path, with slashes, that a foreign file may mean by a name.

    A backslash is a slash. `where` is the place that gave the name, for the message. Raises
    InputError for an absolute path, a drive, `..`, nothing, a control character, or a name that is
    too long.
    """
    parts = [part for part in name.replace("\\", "/").split("/") if part not in ("", ".")]
    if problem := _problem(name, parts):
        raise InputError(f"{where}: the name {name[:80]!r} {problem}: correct or remove it")
    return "/".join(parts)


def _problem(name: str, parts: Sequence[str]) -> str:
    """Return what is wrong with a name; empty if nothing is."""
    if any(unicodedata.category(character) in _FORBIDDEN_CATEGORIES for character in name):
        return "has a control character"
    if not parts:
        return "names no file"
    if name[0] in "/\\" or _DRIVE.match(parts[0]):
        return "is an absolute path"
    if any(not part.strip(" .") for part in parts):  # Windows drops spaces and points at an end
        return "leaves its folder"
    sizes = [len(part.encode()) for part in parts]
    if max(sizes) > LONGEST_PART_BYTES or sum(sizes) + len(sizes) > LONGEST_NAME_BYTES:
        return "is too long"
    return ""


def picture_names(names: Sequence[str]) -> list[str]:
    """Return a file name for the picture of each view, all distinct: images/a.png for images/a.jpg.

    Names that differ in their suffix or in case alone keep their suffix (a.jpg.png); equal names
    are numbered. Raises InputError for a name that is none, see `safe_name`.
    """
    safe = [PurePosixPath(safe_name(name, "the list of views")) for name in names]
    stems = [str(name.with_suffix("")) for name in safe]
    shared = Counter(stem.casefold() for stem in stems)
    taken: set[str] = set()
    found = []
    for name, stem in zip(safe, stems):
        base = stem if shared[stem.casefold()] == 1 else str(name)
        file, number = f"{base}.png", 2
        while file.casefold() in taken:
            file, number = f"{base}_{number}.png", number + 1
        taken.add(file.casefold())
        found.append(file)
    return found
