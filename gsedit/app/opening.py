"""Opening what a person names: scenes, edits, sessions, photos and videos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.app import document as documents
from gsedit.app.document import Pending
from gsedit.app.places import free
from gsedit.capture.folder import PICTURES
from gsedit.capture.frames import SUFFIXES, is_video
from gsedit.errors import GseditError, UsageError
from gsedit.formats.edit_records import read_edit_record
from gsedit.formats.registry import READABLE
from gsedit.run.inputs import safe_name
from gsedit.views.cameras_json import NAME as CAMERAS

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


DROPPED = "dropped"
"""Folder for files that were dropped on the page, below the first place that it may write."""
CAPTURE, FITTED = "capture", "scene.ply"
"""Names in the session's folder of the posed photos, and of the scene that is fitted to them."""
QUALITIES = ("draft", "normal", "high")
EARLIER = 3
"""Sessions that are offered where nothing is open."""


def open_path(page: Page, path: Path) -> None:
    """Open a scene file, the folder of an edit or a session, photos or a video.

    Raises UsageError for what is none of these, and as the page's methods do.
    """
    if not path.exists():
        raise UsageError(f"{path} does not exist: check the path")
    if (path / documents.NAME).is_file():
        return page.open_session(path)
    if (path / FITTED).is_file():
        return page.begin(path, path / FITTED, title_of(path))
    if path.is_file() and path.name.lower().endswith(READABLE):
        return page.begin(path, path, path.name)
    if is_photos(path):
        return page.begin(path)
    kinds = ", ".join(READABLE)
    raise UsageError(f"{path} is no scene ({kinds}), no folder of an edit, of photos, or a video")


def is_photos(path: Path) -> bool:
    """Whether a path is a video, or a folder with photos in it or in a folder of it."""
    if path.is_file():
        return is_video(path)
    nested = (each for depth in ("*", "*/*") for each in path.glob(depth))
    return is_posed(path) or any(each.suffix.lower() in PICTURES for each in nested)


def is_posed(path: Path) -> bool:
    """Whether the cameras of a folder's photos are known."""
    return any((path / name).exists() for name in ("transforms.json", "sparse", "colmap"))


def title_of(folder: Path) -> str:
    """The sentence of an edit's folder, or its name."""
    try:
        return str(read_edit_record(folder / "edit.json").get("instruction") or folder.name)
    except GseditError:
        return folder.name


def waits(page: Page) -> bool:
    """Whether photos or a video are open that have no scene yet."""
    source, document = Path(page.document.source), page.document
    return bool(document.source) and not document.steps and is_photos(source)


def earlier(page: Page) -> tuple[Path, ...]:
    """Folders of the last sessions in the page's folder and among what was dropped, the newest
    first."""
    place = page.places.folders[0]
    depths = ("", f"{DROPPED}/", f"{DROPPED}/*/")
    file = f"*{documents.SUFFIX}/{documents.NAME}"
    found = [each for depth in depths for each in place.glob(depth + file)]
    found.sort(key=lambda file: file.stat().st_mtime, reverse=True)
    return tuple(file.parent for file in found[:EARLIER])


def go_on(page: Page) -> None:
    """Go on with what was in hand when the page was killed: the photos' cameras and their scene, or
    a step. Raises UsageError for what the page does not begin itself."""
    pending = page.document.pending
    if pending is None or pending.command[0] != "fit":
        return page.resume()
    asked = [each for each in QUALITIES if each in pending.command]
    make_scene(page, asked[0] if asked else QUALITIES[0])


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
    page.run(
        command, "finding the cameras", lambda _: fit_scene(page, posed, quality),
        pending=Pending(titled(quality), fit_command(folder, posed, quality)),
    )  # fmt: skip


def fit_scene(page: Page, posed: Path, quality: str) -> None:
    """Fit a scene to posed photos; while it is fitted, tabs show its checkpoints."""
    assert page.folder is not None  # the session of the photos
    command = fit_command(page.folder, posed, quality)
    out = Path(command[command.index("-o") + 1])

    def done(_: Any) -> None:
        assert page.folder is not None
        name = str(out.relative_to(page.folder))
        page.change(documents.opened(Path(page.document.source), Path(name), titled(quality)))

    if (cameras := posed / CAMERAS).is_file():  # which show the scene while it grows
        keep(out.with_name(CAMERAS), cameras.read_bytes())
    checkpoint = out.with_suffix(".checkpoint.safetensors")
    pending = Pending(titled(quality), command)
    page.run(command, "fitting the scene", done, checkpoint, pending)


def titled(quality: str) -> str:
    """The title of the first scene of photos."""
    return f"{quality} scene of the photos"


def fit_command(folder: Path, posed: Path, quality: str) -> tuple[str, ...]:
    """The command that fits the first scene of a session's folder."""
    out = folder / documents.STEPS / f"000-{quality}" / FITTED
    command = ("fit", str(posed), "-o", str(out), "--quality", quality)
    return (*command, "--resume", "-f", "--checkpoint-every", "5")
