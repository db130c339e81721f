"""Work in stages in one folder: finished ones are kept, interrupted ones resumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsedit.errors import InputError, UsageError

from .console import print_message
from .exits import Interrupted
from .outputs import check_folder

OTHER_FOLDER = "name another folder with -o"


@dataclass(frozen=True)
class Stage:
    """One verb's part of the work."""

    name: str
    what: str
    """Description of the stage for a person."""
    asked: Mapping[str, Any]
    """Request that decides the result, with those of the stages before; as JSON holds it."""
    last: Path
    """The file that is written last."""
    work: Callable[[bool], str] = field(compare=False)
    """Run the stage, given whether to resume it; returns a line about the result."""
    instead: str = ""
    """Alternative for an error message where the folder holds another result."""


class Ledger:
    """File with the request and the result of each stage of a folder."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for a damaged file."""
        from gsedit.storage.json_files import read_json

        self.path = path
        self.entries: dict[str, dict[str, Any]] = {}
        try:
            if path.is_file():
                self.entries = {
                    name: {"asked": entry["asked"], "result": entry["result"]}
                    for name, entry in read_json(path).items()
                }
        except (InputError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path} is damaged: remove it, and add -f to do all stages again"
            ) from None

    def is_begun(self, stage: Stage) -> bool:
        """Whether the stage was begun, asked for the same, and did not end."""
        return self.is_same(stage) and not self.ended(stage)

    def is_done(self, stage: Stage) -> bool:
        return self.is_same(stage) and self.ended(stage) and stage.last.is_file()

    def ended(self, stage: Stage) -> bool:
        """Whether there is a result, of this request or another."""
        return stage.name in self.entries and self.entries[stage.name]["result"] is not None

    def is_same(self, stage: Stage) -> bool:
        """Whether the stage was asked for the same."""
        return stage.name in self.entries and not self.changes(stage)

    def result(self, stage: Stage) -> str:
        """The line about its result."""
        return self.entries[stage.name]["result"]

    def changes(self, stage: Stage) -> tuple[str, ...]:
        """Return the names of the parts of the request that have changed."""
        before, now = self.entries.get(stage.name, {}).get("asked"), dict(stage.asked)
        if before is None:
            return ()
        return tuple(key for key in {**before, **now} if before.get(key) != now.get(key))

    def keep(self, stage: Stage, result: str | None) -> None:
        """Write that the stage was begun (None), or what it came to."""
        from gsedit.runs.json_lines import write_record

        names = [*self.entries, stage.name]
        for follows in names[names.index(stage.name) + 1 :]:  # from what is no longer there
            self.entries.pop(follows, None)
        self.entries[stage.name] = {"asked": stage.asked, "result": result}
        write_record(self.entries, self.path, overwrite=True)


def check_stages(stages: Sequence[Stage], ledger: Ledger, *, force: bool) -> None:
    """Raise UsageError, before any work, where the folder holds something else: files that are not
    of these stages, or stages that ended and were asked otherwise; unless `force`."""
    folder = ledger.path.parent
    check_folder(folder, force or bool(ledger.entries))
    for stage in stages:
        changed = ledger.changes(stage)
        if changed and ledger.ended(stage) and not force:
            raise UsageError(
                f"{folder} holds the {stage.name} of another request (other {', '.join(changed)}): "
                f"add -f to replace it and what follows from it, or {stage.instead or OTHER_FOLDER}"
            )


def run_stages(stages: Sequence[Stage], ledger: Ledger) -> None:
    """Do the stages that are not done, with a line each. Raises Interrupted with what to do next,
    and whatever a stage raises."""
    redone = False
    for number, stage in enumerate(stages, 1):
        heading = f"{number} of {len(stages)}, {stage.name}"
        if ledger.is_done(stage) and not redone:
            print_message(f"{heading}: done before ({stage.last})")
            continue
        print_message(f"{heading}: {stage.what}")
        same = ledger.is_begun(stage)
        redone = True
        ledger.keep(stage, None)
        try:
            ledger.keep(stage, stage.work(same))
        except (Interrupted, KeyboardInterrupt):
            raise Interrupted(
                f"interrupted in the {stage.name}; what is done is kept in {ledger.path.parent}: "
                "the same command continues there"
            ) from None
