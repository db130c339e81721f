"""Files that are dropped on the page or chosen in it: kept beside the page's folder, and opened."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.app.opening import DROPPED, open_path, waits
from gsedit.app.places import free
from gsedit.capture.folder import PICTURES
from gsedit.capture.frames import SUFFIXES, is_video
from gsedit.errors import GseditError, UsageError
from gsedit.formats.table import READABLE
from gsedit.storage.safe_names import safe_name

if TYPE_CHECKING:
    from gsedit.app.page import Page

TAKEN = (*PICTURES, *SUFFIXES, *READABLE, ".json", ".txt", ".bin", ".npy")
"""Suffixes of the files that are taken of a folder; the last four are cameras and selections."""


def receive(page: Page, file: Any) -> None:
    """Keep a file that was dropped: a scene or a video is opened, a photo joins the others, a file
    of a folder waits for the folder's end, whose name ends with a slash (page.js).

    Raises UsageError for any other file.
    """
    name = safe_name(file.name, "the dropped file")
    place = page.places.folders[0] / DROPPED
    if "/" in name and file.name.endswith("/"):
        folder = page.places.check(place / name)
        folder.mkdir(parents=True, exist_ok=True)
        return open_path(page, folder)
    if "/" in name:
        return keep(page.places.check(place / name), file.content)
    if name.lower().endswith(PICTURES):
        return receive_photo(page, name, file.content)
    if not name.lower().endswith(READABLE) and not is_video(Path(name)):
        raise UsageError(f"{name} is no scene, photo or video: drop one of these, or a folder")
    target = free(place / name)
    keep(target, file.content)
    try:
        open_path(page, target)
    except GseditError:
        target.unlink()  # nothing to go on with: it would only be in the way
        raise


def receive_photo(page: Page, name: str, content: bytes) -> None:
    """Put a photo to those that wait for their scene, or in a new folder."""
    place = page.places.folders[0] / DROPPED
    source = Path(page.document.source)
    joins = waits(page) and source.parent == place and source.is_dir()
    folder = source if joins else free(place / "photos")
    target = folder / name
    if target.is_file() and target.read_bytes() != content:  # of another camera or day
        target = free(target)
    keep(target, content)
    if joins:
        page.notify("document")
    else:
        page.begin(folder)


def keep(target: Path, content: bytes) -> None:
    """Write a file, in folders that may not be there yet."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content)
