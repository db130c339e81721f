"""The last complete scene of long work: kept if the work ends early, removed when it is done."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_message
from .exits import Interrupted
from .progress import Show

if TYPE_CHECKING:
    from gsedit.reports.events import Checkpoint


@dataclass
class Checkpoints:
    """A context in which the last complete scene is kept; a normal exit removes it."""

    path: Path
    advice: str
    """What the user can do with it; ends the line that names the checkpoint."""
    kept: Checkpoint | None = None

    def keep(self, checkpoint: Checkpoint) -> None:
        """Write the scene over the one kept before."""
        from gsedit.files import save

        self.path.parent.mkdir(parents=True, exist_ok=True)
        save(checkpoint.scene, self.path, overwrite=True)
        self.kept = checkpoint

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        if error is None:
            self.path.unlink(missing_ok=True)
        elif isinstance(error, KeyboardInterrupt):
            raise Interrupted(f"interrupted; {self.left_behind()}") from None
        elif self.kept:
            print_message(f"gsedit: {self.left_behind()}")

    def left_behind(self) -> str:
        """What of the work is on disk, and what to do with it."""
        if self.kept is None:
            if self.path.exists():
                return f"no new checkpoint was complete yet; the earlier one is {self.path}"
            return "no checkpoint was complete yet; add -f to start again"
        step = self.kept.step
        return f"the last complete checkpoint is {self.path} (step {step}); {self.advice}"


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
