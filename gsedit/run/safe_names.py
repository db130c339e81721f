"""Names that foreign files give to views and files: relative paths inside a folder, or errors."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath

from gsedit.errors import InputError

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


def picture_names(names: Sequence[str], suffix: str = ".png") -> list[str]:
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
        file, number = f"{base}{suffix}", 2
        while file.casefold() in taken:
            file, number = f"{base}_{number}{suffix}", number + 1
        taken.add(file.casefold())
        found.append(file)
    return found
