"""Checkpoints of long work: written while it lasts, kept if it ends early, else removed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import GseditError, UsageError
from gsedit.run.atomic import locked

from .console import print_message
from .exits import Interrupted

if TYPE_CHECKING:
    from gsedit.formats.streams import SceneSource
    from gsedit.run.events import Checkpoint
    from gsedit.run.state import State

NAME = "checkpoint.safetensors"
"""Name of the checkpoint in the folder of an edit."""


@dataclass
class Checkpoints:
    """Context that keeps the last checkpoint; a normal exit removes it.

    Only one process at a time is in it: UsageError for another.
    """

    path: Path
    request: Mapping[str, Any] = field(default_factory=dict)
    """The part of the request that the library does not know, for `load_resume_state`."""
    source: Mapping[str, Any] = field(default_factory=dict)
    """Place of the unedited scene, for `open_checkpoint`."""
    check: Callable[[], None] = lambda: None
    """Raises where another process has meanwhile written the output."""
    kept: Checkpoint | None = None
    lock: ExitStack = field(default_factory=ExitStack)
    is_failing: bool = False
    """Whether the last checkpoint could not be written."""

    def keep(self, checkpoint: Checkpoint) -> None:
        """Write the checkpoint over the one kept before. Where that fails, the work goes on."""
        import torch

        from gsedit.run.json_lines import plain
        from gsedit.run.state import save_state

        state = checkpoint.state.along_with(
            command=plain(self.request), source=plain(self.source), threads=torch.get_num_threads()
        )
        try:
            save_state(state, self.path)
            self.kept, self.is_failing = checkpoint, False
        except GseditError as error:
            if not self.is_failing:
                print_message(f"gsedit: the work continues without this checkpoint: {error}")
            self.is_failing = True

    def __enter__(self) -> Checkpoints:
        self.lock.enter_context(locked(self.path))
        try:
            self.check()
        except BaseException:
            self.lock.close()
            raise
        return self

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        with self.lock:
            self.end(error)

    def end(self, error: BaseException | None) -> None:
        """Remove the checkpoint, or say where it is. Raises Interrupted."""
        if error is None:
            self.path.unlink(missing_ok=True)
        elif isinstance(error, KeyboardInterrupt):
            raise Interrupted(f"interrupted; {self.left_behind()}") from None
        elif self.path.exists():
            print_message(f"gsedit: {self.left_behind()}")

    def left_behind(self) -> str:
        """Return what of the work is on disk, and what to do with it."""
        if not self.path.exists():
            return "no checkpoint was complete yet; run the command again"
        step = "" if self.kept is None else f" (step {self.kept.step})"
        return (
            f"the last complete checkpoint is {self.path}{step}; continue with the same command "
            f"and --resume, or write it as a scene with gsedit convert {self.path} SCENE.ply"
        )


def load_resume_state(
    path: Path, request: Mapping[str, Any], work: str, *, resume: bool, force: bool
) -> State | None:
    """Load the checkpoint from which the work (an "edit", a "fit") is to continue.

    `request`: see `Checkpoints`. Returns None where the work starts afresh, with a line where
    --resume finds no checkpoint. Raises UsageError where a checkpoint is left and neither --resume
    nor -f is given, or where it belongs to another request; InputError for a damaged one.
    """
    from gsedit.run.json_lines import plain
    from gsedit.run.state import check_same, load_state

    if not resume:
        if path.exists() and not force:
            raise UsageError(
                f"{path} is left from an interrupted {work}: add --resume to continue it, or -f to "
                "start again"
            )
        return None
    if not path.exists():
        print_message(f"there is no {path} to continue from: the {work} begins")
        return None
    state = load_state(path)
    check_same(plain(request), state.record.get("command", {}), work)
    return state


def say_threads(state: State | None) -> None:
    """Print a line where the work continues with another number of threads."""
    import torch

    now = torch.get_num_threads()
    if state is not None and (before := state.record.get("threads", now)) != now:
        print_message(
            f"the work was begun on {before} threads and continues on {now}: its result may differ "
            f"by rounding from that of an uninterrupted one; add --threads {before} for the same"
        )


def open_checkpoint(path: Path) -> SceneSource:
    """Open the scene of a checkpoint. Raises InputError for a file that is none."""
    from gsedit.capture.fitting.optimizer import optimized_scene
    from gsedit.formats.scenes import read_scene
    from gsedit.formats.streams import SceneHeader, SceneSource, in_blocks
    from gsedit.run.state import load_state, restoring
    from gsedit.scene.table import table_of

    state = load_state(path)
    source, unedited = state.record.get("source", {}), None
    if "scene" in source:
        unedited = read_scene(Path(source["scene"]), drop_invalid=source["drop_invalid"]).scene
    with restoring(state):
        table = table_of(optimized_scene(state.within("optimizer"), unedited))
    header = SceneHeader(table.degree)
    return SceneSource(path, "checkpoint", header, len(table), lambda: in_blocks(table))
