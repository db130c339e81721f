"""The document of a session: the scene that was opened, what was done to it, and the place in that.

A session is a folder: `session.json` is the document, `steps/` has a folder for each step. The file
is written anew at each change, whole or not at all, so a session survives being killed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import chain, count
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.run.atomic import locked
from gsedit.run.json_files import list_of, number, object_of, read_json, text
from gsedit.run.json_lines import write_record


def undone(document: Document, session: Path | None) -> tuple[list[Path], int]:
    """Find the folders of a session that no step up to the one that is shown needs, and the bytes
    of their files; without what can go on after an interruption."""
    if session is None or not (session / STEPS).is_dir():
        return [], 0
    done = document.steps[: document.position + 1]
    waiting = () if document.pending is None else document.pending.command
    named = [part for each in done for part in (each.scene, *each.command)]
    kept = [(session / each).resolve() for each in (*named, *waiting)]
    folders = [
        each
        for each in sorted((session / STEPS).resolve().iterdir())
        if each.is_dir() and not each.is_symlink() and not any(k.is_relative_to(each) for k in kept)
    ]
    files = [file for each in folders for file in each.rglob("*") if file.is_file()]
    return folders, sum(file.lstat().st_size for file in files)


NAME = "session.json"
STEPS = "steps"
SUFFIX = ".session"
"""Suffix of a session's folder, which lies beside what was opened."""


@dataclass(frozen=True)
class Step:
    """One scene of the history, and how it was made."""

    title: str
    scene: str
    """The scene's file: absolute, or relative to the session's folder."""
    command: tuple[str, ...] = ()
    """Arguments of gsedit that made it of the step before; none for a scene that was opened."""


@dataclass(frozen=True)
class Eye:
    """Place that a person looks from, in the scene's world."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float
    """Field of view across the shorter side of the window, radians."""


@dataclass(frozen=True)
class Pending:
    """Work that was begun and has not ended: after a restart it can go on."""

    title: str
    command: tuple[str, ...]


@dataclass(frozen=True)
class Document:
    """The history of a session. Steps after `position` are undone and can be done again."""

    source: str = ""
    """Path that was opened: a scene, photos or a video."""
    steps: tuple[Step, ...] = ()
    position: int = -1
    """Step that is shown; -1 before any."""
    eye: Eye | None = None
    pending: Pending | None = None

    @property
    def current(self) -> Step | None:
        """The step that is shown; None before any."""
        return self.steps[self.position] if self.position >= 0 else None


def opened(source: Path, scene: Path, title: str) -> Document:
    """The document of a scene that was just opened."""
    return Document(str(source), (Step(title, str(scene)),), 0)


def applied(document: Document, step: Step) -> Document:
    """The document after one more step; what was undone before is forgotten."""
    kept = document.steps[: document.position + 1]
    return replace(document, steps=(*kept, step), position=len(kept), pending=None)


def moved(document: Document, position: int) -> Document:
    """The document at another step of its history, the nearest to `position` that there is."""
    return replace(
        document,
        position=max(min(position, len(document.steps) - 1), min(0, len(document.steps) - 1)),
    )


def session_folder(source: Path) -> Path:
    """The folder of the session of a scene, of photos or of an edit: beside it, and not that of
    something else which is called nearly the same, as bear.spz is beside bear.ply.

    Raises InputError for a damaged session of that name.
    """
    if (source / NAME).is_file():
        return source
    name = source.name
    own = (source.stem if source.is_file() else name, name)
    names = chain(own, (f"{name}-{i}" for i in count(2)))
    folders = (source.with_name(f"{each}{SUFFIX}") for each in names)
    return next(
        each for each in folders if not (each / NAME).is_file() or load(each).source == str(source)
    )


def step_folder(folder: Path, title: str) -> Path:
    """A folder for the next step that no other step has; it is not made."""
    places = [each.name for each in (folder / STEPS).glob("*")]
    numbers = [int(name.split("-")[0]) for name in places if name.split("-")[0].isdecimal()]
    words = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40].strip("-")
    return folder / STEPS / f"{max(numbers, default=0) + 1:03d}-{words or 'step'}"


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Have a session for this process alone. Raises UsageError where another has it."""
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(folder / NAME))
        except UsageError as error:
            told = f"{folder} is open in another gsedit app: go on there, or end it"
            raise UsageError(told) from error
        yield


def save(document: Document, folder: Path) -> None:
    """Write the document of a session. What lies beside its folder is named from there: both may be
    moved together. Raises GseditError where the disk does not take it."""
    record = asdict(document)
    record["source"] = _from_session(document.source, folder)
    for each in record["steps"]:
        each["scene"] = _from_session(each["scene"], folder)
    write_record(record, folder / NAME, overwrite=True)


def load(folder: Path) -> Document:
    """Read the document of a session. Raises InputError for a damaged one."""
    record = read_json(folder / NAME, _DOCUMENT, advice="remove it to begin the session anew")
    steps = tuple(
        Step(each["title"], _beside(each["scene"], folder), tuple(each["command"]))
        for each in record["steps"]
    )
    eye, pending = record.get("eye"), record.get("pending")
    if eye is not None:
        position, target, up = (tuple(eye[name]) for name in ("position", "target", "up"))
        eye = Eye(position, target, up, eye["fov"])
    if pending is not None:
        pending = Pending(pending["title"], tuple(pending["command"]))
    document = Document(_beside(record["source"], folder), steps, eye=eye, pending=pending)
    return moved(document, int(record["position"]))


def _from_session(path: str, folder: Path) -> str:
    """A path as the session's file has it: from the session's folder where it lies beside that."""
    beside = Path(path).is_absolute() and Path(path).is_relative_to(folder.parent)
    return f"{_UP}{Path(path).relative_to(folder.parent).as_posix()}" if beside else path


def _beside(path: str, folder: Path) -> str:
    """A path of the session's file with its folder, where it lies beside that."""
    return str(folder.parent / path.removeprefix(_UP)) if path.startswith(_UP) else path


_UP = "../"
_ARGUMENTS = list_of(text(empty=True))
_POINT = list_of(number(), 3)
_DOCUMENT = object_of(
    {
        "source": text(empty=True),
        "steps": list_of(
            object_of({"title": text(empty=True), "scene": text(), "command": _ARGUMENTS})
        ),
        "position": number(-1.0),
    },
    {
        "eye": object_of(
            {"position": _POINT, "target": _POINT, "up": _POINT, "fov": number(0.01, 3.1)}
        ),
        "pending": object_of({"title": text(), "command": _ARGUMENTS}),
    },
)
