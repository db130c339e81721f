"""Where long work can go on: written while it lasts, kept if it ends early, else removed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message
from .exits import Interrupted
from .progress import Show

if TYPE_CHECKING:
    from gsedit.files.state import State
    from gsedit.reports.events import Checkpoint

NAME = "checkpoint.safetensors"
"""In the folder of an edit."""

Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Go on from the last checkpoint of the same command, which was interrupted. With -f, "
        "start where there is none.",
    ),
]


@dataclass
class Checkpoints:
    """A context in which the last checkpoint is kept; a normal exit removes it."""

    path: Path
    asked: Mapping[str, Any] = field(default_factory=dict)
    """What the command was asked for that the library does not know, for `going_on` to compare."""
    source: Mapping[str, Any] = field(default_factory=dict)
    """Where the unedited scene is, for `gsedit recover`."""
    kept: Checkpoint | None = None

    def keep(self, checkpoint: Checkpoint) -> None:
        """Write the checkpoint over the one kept before."""
        from gsedit.files.state import save_state
        from gsedit.reports.json_lines import plain

        state = checkpoint.state.along_with(command=plain(self.asked), source=plain(self.source))
        save_state(state, self.path)
        self.kept = checkpoint

    def __enter__(self) -> Checkpoints:
        from gsedit.files.atomic import remove_temporaries

        remove_temporaries(self.path)
        return self

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        if error is None:
            self.path.unlink(missing_ok=True)
        elif isinstance(error, KeyboardInterrupt):
            raise Interrupted(f"interrupted; {self.left_behind()}") from None
        elif self.path.exists():
            print_message(f"gsedit: {self.left_behind()}")

    def left_behind(self) -> str:
        """What of the work is on disk, and what to do with it."""
        if not self.path.exists():
            return "no checkpoint was complete yet; run the command again"
        step = "" if self.kept is None else f" (step {self.kept.step})"
        return (
            f"the last complete checkpoint is {self.path}{step}; go on with the same command and "
            f"--resume, or make a scene of it with gsedit recover {self.path} -o SCENE.ply"
        )


def going_on(
    path: Path, asked: Mapping[str, Any], work: str, *, resume: bool, force: bool
) -> State | None:
    """The state of the checkpoint at `path`, if the work (an "edit", a "fit") is to go on.

    `asked`: see `Checkpoints`. Raises UsageError where there is no checkpoint and --resume without
    -f, a checkpoint and neither, or the checkpoint of a command that was `asked` something else;
    InputError for a damaged one.
    """
    from gsedit.errors import UsageError
    from gsedit.files.state import check_same, load_state
    from gsedit.reports.json_lines import plain

    if not resume:
        if path.exists() and not force:
            raise UsageError(
                f"{path} is left from an interrupted {work}: add --resume to go on from it, or -f "
                "to start again"
            )
        return None
    if not path.exists():
        if force:
            return None
        raise UsageError(
            f"there is no {path} to go on from: the {work} ended, or was interrupted before its "
            "first checkpoint; leave --resume out"
        )
    state = load_state(path)
    check_same(plain(asked), state.record.get("command", {}), work)
    return state


def run_to_result(items: Iterable[Any], show: Show, checkpoints: Checkpoints) -> Any:
    """Show the events and keep the checkpoints that `items` yields; its result, the last item."""
    from gsedit.reports.events import Checkpoint, Event

    result = None
    for item in items:
        match item:
            case Event():
                show(item)
            case Checkpoint():
                checkpoints.keep(item)
            case _:
                result = item
    if result is None:
        raise RuntimeError("the work ended without a result")
    return result
