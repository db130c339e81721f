"""Events that long work yields: measurements on the way, and scenes worth keeping."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

from gsedit.run.state import State, restoring
from rasterizer.scene import Gaussians

T = TypeVar("T")


@dataclass(frozen=True)
class Event:
    """Something that happened in a long piece of work: one line of metrics.jsonl."""

    stage: str
    """Stage of the work: survey, skip, estimate, region, correspond, sample, update, strokes and
    measure in an edit; fit; render; a benchmark has names of its own."""
    seconds: float
    """Wall clock since the work began."""
    step: int = 0
    steps: int = 0
    """Position within the stage; 0 of 0 where it has no steps."""
    loss: float | None = None
    error: float | None = None
    """RMSE of colors in [0, 1] against what the stage aims at: held-out photos, edited targets."""
    note: str = ""
    """One human sentence, where there is something to say."""
    left: float | None = None
    """Seconds to the end of the stage, where the work knows; its steps may cost differently."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Work that could go on from here. It shows the work as it is: write it, or read its scene,
    before the next item is asked for."""

    state: State
    step: int
    seconds: float
    copy_scene: Callable[[], Gaussians]

    @property
    def scene(self) -> Gaussians:
        """A copy of the complete scene, made when it is asked for."""
        return self.copy_scene()


def as_record(event: Event) -> dict[str, Any]:
    """The fields of an event that hold something, by name: a line of metrics.jsonl."""
    return {name: value for name, value in vars(event).items() if value not in (None, "")}


def events_of(state: State) -> list[Event]:
    """The events that the record of a state holds. Raises InputError for a damaged one."""
    with restoring(state):
        return [Event(**each) for each in state.record["events"]]


def returned(steps: Generator[Any, None, T]) -> T:
    """The value that long work returns; what it yields is dropped."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
