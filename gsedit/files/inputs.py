"""Checks of an input before it is parsed: it exists, is not empty, lies in its folder."""

from __future__ import annotations

from pathlib import Path

from gsedit.errors import InputError


def existing_file(path: str | Path) -> Path:
    """The path of a file that exists and is not empty; otherwise InputError."""
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder, not a file: name a file inside it")
        with path.open("rb") as file:
            size = file.seek(0, 2)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check the path") from None
    if size == 0:
        raise InputError(f"{path} is empty (0 bytes): copy or export it again")
    return path


def file_inside(folder: Path, relative: str, where: str) -> Path:
    """`folder / relative`, which must not leave the folder: not by `..`, a root, or a link.

    A dataset may come from anybody, so it may name its own files only. `where` is the place that
    named the file, for the message. Raises InputError.
    """
    path = folder / relative
    try:
        stays = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of links; a zero byte in the name
        stays = False
    if not stays:
        raise InputError(
            f"{where}: {relative!r} leaves the dataset folder {folder}: "
            "copy the file into the folder and name it relative to it"
        )
    return path


def beside(scene: Path, name: str) -> Path:
    """bear.NAME of bear.ply: a file that belongs to one scene of a folder."""
    packed = ".compressed.ply"
    stem = scene.name[: -len(packed)] if scene.name.lower().endswith(packed) else scene.stem
    return scene.with_name(f"{stem}.{name}")
