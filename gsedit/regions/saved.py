"""Selections with a name, kept beside a scene file: bear.regions/chair.npy of bear.ply."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError
from gsedit.storage.inputs import beside

if TYPE_CHECKING:
    from gsedit.regions.region import Region

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _-]{0,63}")
"""Letters, digits, blanks, _ and -: no suffix, no path, no colon, as the other regions have."""
TAKEN = frozenset(
    ("all", "auto", "everything", "scene", "background", "backdrop", "surroundings", "sky",
     "ground", "subject", "object", "thing", "rest", "it", "its", "itself", "him", "her", "them",
     "this", "that", "these", "those", "one", "ones", "other", "copy", "a", "an", "the", "my",
     "left", "right", "front", "back", "top", "bottom", "middle", "light", "camera")
)  # fmt: skip
"""Words that already mean a region, a place or nothing of their own in a sentence."""


def check_name(name: str) -> str:
    """The name of a selection without blanks around it. Raises UsageError for what is none."""
    name = name.strip()
    if not NAME.fullmatch(name):
        raise UsageError(
            f"{name!r} is no name for a selection: give letters, digits, blanks, - or _"
        )
    bare = name.lower().removeprefix("the ").strip()
    if bare in TAKEN:
        raise UsageError(
            f"{name!r} is no name for a selection: sentences mean something else by it; give the "
            "name of the thing, as in --as chair"
        )
    return name


def folder_of(scene: str | Path) -> Path:
    """The folder of the saved selections of a scene file; it may not exist."""
    return beside(Path(scene), "regions")


def saved_names(scene: str | Path) -> tuple[str, ...]:
    """The names of the selections saved beside a scene file, sorted."""
    return tuple(sorted(path.stem for path in folder_of(scene).glob("*.npy")))


def saved_file(scene: str | Path, name: str) -> Path | None:
    """The .npy file of a saved selection, by its name in any case; None where there is none."""
    wanted = name.strip().lower()
    found = [each for each in saved_names(scene) if each.lower() == wanted]
    return folder_of(scene) / f"{found[0]}.npy" if found else None


def save_named(region: Region, scene: str | Path, name: str, *, overwrite: bool = False) -> Path:
    """Save a selection beside a scene file, whole or not at all; the path of its file.

    Raises UsageError for what is no name, or one that exists, unless `overwrite`.
    """
    from gsedit.regions.region import save_region

    path = saved_file(scene, name) or folder_of(scene) / f"{check_name(name)}.npy"
    if path.exists() and not overwrite:
        raise UsageError(f"the selection {name} of {scene} exists: add --force to replace it")
    path.parent.mkdir(exist_ok=True)
    save_region(region, path, overwrite=overwrite)
    return path
