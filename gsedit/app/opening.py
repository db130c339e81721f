"""Opening what a person names or drops: scenes, edits, sessions, photos and videos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.app import document as documents
from gsedit.capture.folder import PICTURES
from gsedit.capture.frames import is_video
from gsedit.errors import GseditError, UsageError
from gsedit.formats.edit_records import read_edit_record
from gsedit.formats.registry import READABLE
from gsedit.storage.safe_names import safe_name

if TYPE_CHECKING:
    from gsedit.app.page import Page

DROPPED = "dropped"
"""Folder for files that were dropped on the page, below the first place that it may write."""
CAPTURE, FITTED = "capture", "scene.ply"
"""Names in the session's folder of the posed photos, and of the scene that is fitted to them."""
QUALITIES = ("draft", "normal", "high")


def open_path(page: Page, path: Path) -> None:
    """Open a scene file, the folder of an edit or a session, photos or a video.

    Raises UsageError for what is none of these, and as the page's methods do.
    """
    if not path.exists():
        raise UsageError(f"{path} does not exist: check the path")
    if (path / documents.NAME).is_file():
        return page.open_session(path)
    if (path / FITTED).is_file():
        return page.open_scene(path / FITTED, title_of(path), path)
    if path.is_file() and path.name.lower().endswith(READABLE):
        return page.open_scene(path, path.name)
    if is_photos(path):
        return page.begin(path)
    kinds = ", ".join(READABLE)
    raise UsageError(f"{path} is no scene ({kinds}), no folder of an edit, of photos, or a video")


def is_photos(path: Path) -> bool:
    """Whether a path is a video, or a folder with photos in it or in a folder of it."""
    if path.is_file():
        return is_video(path)
    posed = any((path / name).exists() for name in ("transforms.json", "sparse", "colmap"))
    nested = (each for depth in ("*", "*/*") for each in path.glob(depth))
    return posed or any(each.suffix.lower() in PICTURES for each in nested)


def is_posed(path: Path) -> bool:
    """Whether the cameras of a folder's photos are known."""
    return any((path / name).exists() for name in ("transforms.json", "sparse", "colmap"))


def title_of(folder: Path) -> str:
    """The sentence of an edit's folder, or its name."""
    try:
        return str(read_edit_record(folder / "edit.json").get("instruction") or folder.name)
    except GseditError:
        return folder.name


def make_scene(page: Page, quality: str = "draft") -> None:
    """Pose the photos of the session, where that is not done, and fit a scene to them.

    What an interrupted run left is gone on with. Raises UsageError where there are no photos.
    """
    source, folder = Path(page.document.source), page.folder
    if folder is None or not page.document.source or not is_photos(source):
        raise UsageError("open a folder of photos or a video first")
    posed = source if is_posed(source) else folder / CAPTURE
    if posed == source or (posed / "capture.json").is_file():
        return fit_scene(page, posed, quality)
    command = ("capture", str(source), "-o", str(posed))
    page.run(command, "finding the cameras", lambda _: fit_scene(page, posed, quality))


def fit_scene(page: Page, posed: Path, quality: str) -> None:
    """Fit a scene to posed photos; while it is fitted, tabs show its checkpoints."""
    assert page.folder is not None  # the session of the photos
    out = page.folder / documents.STEPS / f"000-{quality}" / FITTED
    command = ("fit", str(posed), "-o", str(out), "--quality", quality, "--resume", "-f")
    more = ("--checkpoint-every", "5")

    def done(_: Any) -> None:
        assert page.folder is not None
        name = str(out.relative_to(page.folder))
        page.change(documents.opened(Path(page.document.source), Path(name), f"{quality} scene"))

    checkpoint = out.with_suffix(".checkpoint.safetensors")
    page.run((*command, *more), "fitting the scene", done, checkpoint)


def receive(page: Page, file: Any) -> None:
    """Keep a file that was dropped: a scene or a video is opened, a photo joins the others.

    Raises UsageError for any other file.
    """
    name = safe_name(Path(file.name).name, "the dropped file")
    low = name.lower()
    place = page.places.folders[0] / DROPPED
    if low.endswith(PICTURES):
        target = place / "photos" / name
        if target.is_file() and target.read_bytes() != file.content:  # of another camera or day
            target = free(target)
    elif low.endswith(READABLE) or is_video(Path(name)):
        target = free(place / name)
    else:
        raise UsageError(f"{name} is no scene, photo or video: its suffix is not known")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(file.content)
    if target.parent == place:
        try:
            open_path(page, target)
        except GseditError:
            target.unlink()  # nothing to go on with: it would only be in the way
            raise
    elif page.document.source != str(target.parent):
        page.begin(target.parent)
    else:
        page.notify("document")


def free(path: Path) -> Path:
    """A path that is free: this one, or one with a number."""
    suffix = next((each for each in READABLE if path.name.lower().endswith(each)), path.suffix)
    stem, number, found = path.name[: -len(suffix)] if suffix else path.name, 1, path
    while found.exists():
        number += 1
        found = path.with_name(f"{stem}-{number}{suffix}")
    return found
