"""Checks of the places where a verb writes, before any work begins."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.run.atomic import check_writable, is_temporary


def check_file(path: Path | None, force: bool, suffix: str = "") -> None:
    """Raise UsageError unless a file of that suffix can be written at `path`, if it is given:
    checked before the work."""
    if path is None:
        return
    if not path.name.lower().endswith(suffix):
        raise UsageError(f"{path}: name a {suffix} file")
    check_writable(path, overwrite=force)
    _check_permission(path.parent)


def check_scene_file(path: Path, force: bool) -> None:
    """Raise UsageError unless a scene can be written at `path`."""
    from gsedit.formats.scenes import WRITABLE

    if not path.name.lower().endswith(WRITABLE):
        raise UsageError(f"-o {path}: name a scene file: {', '.join(WRITABLE)}")
    check_file(path, force)


def check_folder(path: Path, force: bool, *, leftovers: Collection[str] = ()) -> None:
    """Raise UsageError unless `path` can be a folder of results: new or empty, or -f was given.

    Files of the names `leftovers` are nothing to keep, nor are those whose writing was interrupted.
    """
    if os.path.lexists(path) and not path.is_dir():
        raise UsageError(f"-o {path} is a file, or a link that leads nowhere: name a folder")
    _check_permission(path)
    names = {each.name for each in path.iterdir()} if path.is_dir() else set()
    if not force and any(name not in leftovers and not is_temporary(name) for name in names):
        raise UsageError(
            f"-o {path} has files in it already: add -f to replace them, or choose another folder"
        )


def _check_permission(folder: Path) -> None:
    nearest = next(p for p in (folder, *folder.absolute().parents) if os.path.lexists(p))
    if not nearest.is_dir():
        raise UsageError(
            f"-o: {nearest} is a file, or a link that leads nowhere: choose another folder"
        )
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise UsageError(f"-o: no permission to write in {nearest}; choose another place")
