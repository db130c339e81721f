"""State that all tabs of a page share: document, scene, selection, and the work in hand."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock, RLock
from typing import Any, TypeAlias

from torch import Tensor

from gsedit.app import document as documents
from gsedit.app.document import Document, Eye, Pending, Step
from gsedit.app.loaded import Loaded, Scenes, read_checkpoint
from gsedit.app.places import Places, free
from gsedit.app.steps import CHECKPOINT, bring_along, folder_of_step, region_file, resumed, step_of
from gsedit.app.worker import Cancelled, Done, Work, Worker
from gsedit.errors import GseditError, UsageError
from rasterizer.scene import Gaussians

Screen: TypeAlias = Any
"""A `gsedit.app.tab.Tab`, of a module above this one."""


class Audience:
    """Tabs of a page, and functions that are called after changes, each as long as its tab is
    open."""

    def __init__(self) -> None:
        """Begin without any tab."""
        self.tabs: list[Screen] = []
        self._functions: list[tuple[Screen, str, Callable[[], None]]] = []

    def join(self, tab: Screen) -> None:
        """Take a tab that was opened."""
        self.tabs.append(tab)

    def part(self, tab: Screen) -> None:
        """Forget a tab that was closed; work goes on without it."""
        if tab in self.tabs:
            self.tabs.remove(tab)
        self._functions = [each for each in self._functions if each[0] is not tab]
        tab.close()

    def listen(self, tab: Screen, what: str, function: Callable[[], None]) -> None:
        """Call a function after each change of the "scene", the "selection", the "document", of
        "busy" or "growing", and when a command or a session has "begun", while the tab is open."""
        self._functions.append((tab, what, function))

    def notify(self, what: str) -> None:
        """Call the functions that listen to a change; what one raises its tab says."""
        for tab, each, function in list(self._functions):
            if each == what:
                try:
                    function()
                except Exception as error:
                    tab.fail(error)

    def say(self, text: str) -> None:
        """Say something in all tabs."""
        for tab in list(self.tabs):
            tab.tell(text)

    def fail(self, error: Exception | str) -> None:
        """Say in all tabs what went wrong."""
        for tab in list(self.tabs):
            tab.fail(error)


NOTHING_OPEN = "open a scene first: under File, by its path, or drop it on the page"


class Page(Audience):
    """State that all tabs share. Its methods can be called from any thread."""

    def __init__(self, worker: Worker, places: Places) -> None:
        """Begin without a scene."""
        super().__init__()
        self.places = places
        self.document = Document()
        self.folder: Path | None = None
        """The session's folder; None before anything is open."""
        self.selection: Tensor | None = None
        """Flags of the current scene's Gaussians; None where nothing is selected."""
        self.note = ""
        """How the selection was found."""
        self.growing: Loaded | None = None
        """The scene that the command in hand has made so far, where it tells."""
        self.pictures: dict[Any, str] = {}
        """Small pictures of steps, and of looks of the first one, as addresses that hold them."""
        self.drawing = Lock()
        """Held by the one thread that makes pictures of looks."""
        self.about = 0.0
        """Seconds that the command in hand takes; 0 where that is not known."""
        self.worker = worker
        """Runs the command in hand."""
        worker.tell = self._worked
        self._checkpoint: tuple[Path | None, int] = (None, 0)
        """File of the command in hand that grows, and when the shown state was written."""
        self._scenes = Scenes()
        self._lock = RLock()
        self._session = ExitStack()
        self._closed = False

    # -- the scene

    @property
    def has_scene(self) -> bool:
        """Whether there is a current scene."""
        return self.document.current is not None

    @property
    def scene_file(self) -> Path:
        """File of the current scene. Raises UsageError where nothing is open."""
        return self.file_of(self.document.position)

    @property
    def loaded(self) -> Loaded:
        """The current scene as it was read. Raises UsageError where nothing is open."""
        return self.load(self.scene_file)

    @property
    def scene(self) -> Gaussians:
        """The current scene. Raises UsageError where nothing is open."""
        return self.loaded.scene

    @property
    def visible(self) -> Loaded | None:
        """The scene in the making, or else the current one; None where there is neither."""
        return self.growing or (self.loaded if self.has_scene else None)

    def file_of(self, position: int) -> Path:
        """File of the scene of a step. Raises UsageError where there is no such step."""
        if self.folder is None or not 0 <= position < len(self.document.steps):
            raise UsageError(NOTHING_OPEN)
        return self.folder / self.document.steps[position].scene

    def load(self, file: Path) -> Loaded:
        """A scene of the history, read once and kept while there is room."""
        return self._scenes.load(file)

    # -- the selection

    def select(self, flags: Tensor | None, note: str = "") -> None:
        """Select Gaussians in all tabs; None, or no flag that is set: nothing."""
        if flags is not None and len(flags) != len(self.scene):
            raise UsageError("the scene has changed meanwhile: select once more")
        self.selection = None if flags is None or not bool(flags.any()) else flags
        self.note = note if self.selection is not None else ""
        self.notify("selection")

    def selection_file(self) -> Path | None:
        """The selection as a .npy file of the session, for --region; None where there is none."""
        if self.selection is None or self.folder is None:
            return None
        return region_file(self.selection, self.folder)

    def region_options(self) -> tuple[str, ...]:
        """Options that keep a command to the selection; none where nothing is selected."""
        file = self.selection_file()
        return () if file is None else ("--region", str(file))

    # -- the session

    def begin(self, source: Path, scene: Path | None = None, title: str = "") -> None:
        """Go on with the session of photos, an edit or a scene, or begin one beside it: with the
        file of a `scene`, or None where photos have none yet.

        Raises InputError for a damaged file, UsageError where another page has the session.
        """
        folder = documents.session_folder(source)
        if (folder / documents.NAME).is_file():
            return self.open_session(folder)
        if scene is None:
            self._enter(folder)
            return self.change(Document(str(source)))
        self.load(scene)  # before the session of another scene is left
        self._enter(folder)
        self.change(documents.opened(source, scene, title))

    def open_session(self, folder: Path) -> None:
        """Go on with a session where it was left. Raises InputError for a damaged one, UsageError
        for one that names files which the page may not read."""
        document = documents.load(folder)
        for each in filter(None, (document.source, *(step.scene for step in document.steps))):
            self.places.check(folder / each)
        if document.current is not None:
            self.load(folder / document.current.scene)
        self._enter(folder)
        self.change(document)

    def change(self, document: Document) -> None:
        """Take a new state of the document: save it, and show its scene where that is another."""
        with self._lock:
            before, self.document = self._shown_file(), document
            same = before == self._shown_file()
            self.save()
            if not same and self.selection is not None:
                fits = self.has_scene and len(self.selection) == len(self.scene)
                self.selection = self.selection if fits else None
        if not same:
            self.notify("scene")
        self.notify("document")

    def save(self) -> None:
        """Write the document. A full disk is told, and does not end the page."""
        if self.folder is not None:
            try:
                documents.save(self.document, self.folder)
            except GseditError as error:
                self.fail(error)

    def look(self, eye: Eye) -> None:
        """Remember where a person looks from."""
        with self._lock:
            if self.has_scene and eye != self.document.eye:
                self.document = replace(self.document, eye=eye)
                self.save()

    def undo(self) -> None:
        """Go a step back. Raises UsageError at the first."""
        self._move(-1, "there is nothing to undo: this is the first step")

    def redo(self) -> None:
        """Go a step forth again. Raises UsageError at the last."""
        self._move(1, "there is nothing to redo: this is the last step")

    def _move(self, steps: int, nowhere: str) -> None:
        self.worker.check_idle()
        position = self.document.position + steps
        if not 0 <= position < len(self.document.steps):
            raise UsageError(nowhere)
        self.go_to(position)

    def go_to(self, position: int) -> None:
        """Show the scene of a step of the history, the nearest that there is."""
        self.worker.check_idle()
        found = documents.moved(self.document, position)
        if found.position >= 0:
            self.load(self.file_of(found.position))  # a damaged file changes nothing
        self.change(found)

    def undone(self) -> tuple[list[Path], int]:
        """Folders of steps that are undone, or never ended, and their bytes on the disk."""
        return documents.undone(self.document, self.folder)

    def discard_undone(self) -> None:
        """Remove them for good. Raises UsageError where a command is in hand."""
        self.worker.check_idle()
        folders, _ = self.undone()
        done = self.document.steps[: self.document.position + 1]
        self.change(replace(self.document, steps=done))  # first: no step names what is gone
        for each in folders:
            self._scenes.forget(each)
            shutil.rmtree(each)
        self.notify("document")

    def new_file(self, name: str) -> Path:
        """A path in the session's exports that is free."""
        if self.folder is None:
            raise UsageError(NOTHING_OPEN)
        return free(self.folder / "exports" / Path(name).name)

    def _enter(self, folder: Path) -> None:
        """Leave the session, and take another's folder for this process alone."""
        self.worker.check_idle()
        self.notify("begun")
        if folder == self.folder:
            return
        taken = ExitStack()
        taken.enter_context(documents.held(folder))
        self.save()
        self._session.close()
        self._session, self.folder, self.selection = taken, folder, None
        self.pictures.clear()
        self.document = Document()

    def _shown_file(self) -> Path | None:
        return self.scene_file if self.has_scene else None

    # -- work

    @property
    def busy(self) -> Work | None:
        """The command in hand; None where there is none."""
        return self.worker.busy

    def step(
        self, verb: str, *arguments: str, title: str, after: Callable[[], None] | None = None,
        about: float = 0.0,
    ) -> None:  # fmt: skip
        """Run a verb on the current scene, for `about` so many seconds (0: not known); its result
        becomes the next step.

        The command is [verb, SCENE, *arguments, "-o", OUT]; `after` is called once the step is
        shown, in a thread. Raises UsageError where a command is in hand.
        """
        scene = self.scene_file
        assert self.folder is not None  # there is a scene
        self._begin(step_of(verb, scene, arguments, title, self.folder), after)
        self.about = about

    def resume(self) -> None:
        """Do the step again that was in hand when the page was killed, from its last checkpoint
        where it has one."""
        if self.document.pending is not None and self.folder is not None:
            self._begin(resumed(self.document.pending, self.folder), None)

    def run(
        self,
        command: Sequence[str],
        title: str,
        done: Done | None = None,
        checkpoint: Path | None = None,
        pending: Pending | None = None,
    ) -> None:
        """Run a command; `done` is given the record of its result, in a thread.

        While it runs, the scene of its `checkpoint` is shown; where it is killed, the document has
        `pending` to go on with (None: what waits there goes on to wait). Raises UsageError where a
        command is in hand.
        """

        def ended(record: dict[str, Any]) -> None:
            self.growing = None
            if done is not None:
                done(record)

        with self._lock:
            self.worker.check_idle()
            self.notify("begun")
            if pending not in (None, self.document.pending):
                self.document = replace(self.document, pending=pending)
                self.save()
            self._checkpoint, self.about = (checkpoint, 0), 0.0
            self.worker.begin(command, title, ended, partial(self._failed, pending))

    def _begin(self, pending: Pending, after: Callable[[], None] | None) -> None:
        done = partial(self._stepped, pending, after)
        checkpoint = folder_of_step(pending) / CHECKPOINT
        self.run(pending.command, pending.title, done, checkpoint, pending)

    def _worked(self) -> None:
        """Show the checkpoint of the command in hand where it is new, and tell how far that is."""
        file, shown = self._checkpoint
        with suppress(OSError, GseditError):  # there is none yet, or it is being replaced
            if self.busy is not None and file is not None:
                written = file.stat().st_mtime_ns
                if written != shown:
                    self._checkpoint = file, written
                    self._grow(read_checkpoint(file, self.scene if self.has_scene else None))
        self.notify("busy")

    def _grow(self, found: Loaded | None) -> None:
        """Show the scene that the command in hand has made so far; None: no more."""
        self.growing = found
        self.notify("growing")

    def _failed(self, pending: Pending | None, error: Exception) -> None:
        if self._closed:
            return  # what was in hand can go on when the session is opened again
        self._grow(None)
        if pending is not None:
            with self._lock:
                self.document = replace(self.document, pending=None)
                self.save()
        if isinstance(error, Cancelled):
            self.say("cancelled: nothing has changed")
        else:
            self.fail(error)
        self.notify("document")

    def _stepped(
        self, pending: Pending, after: Callable[[], None] | None, record: dict[str, Any]
    ) -> None:
        """Make the scene that a command wrote the next step."""
        assert self.folder is not None
        file = folder_of_step(pending) / "scene.ply"
        bring_along(self.loaded, self.load(file))
        step = Step(pending.title, str(file.relative_to(self.folder)), pending.command)
        if pending.command[0] == "edit":
            self.selection = None  # it was this sentence's: the next one names its own
        self.change(documents.applied(self.document, step))
        if after is not None:
            after()

    def close(self) -> None:
        """End the work and leave the session, which can be opened again where it is."""
        self._closed = True
        self.worker.close()
        self.save()
        self._session.close()
