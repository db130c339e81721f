"""A sentence as it is understood while it is typed: what changes, by which way, how long."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Literal

from gsedit.app.places import Places
from gsedit.editing.plan import is_exact, steps_of
from gsedit.errors import Said, UsageError, on_page
from gsedit.paper.editors.protocol import Editor, following
from gsedit.paper.editors.registry import make_editor
from gsedit.words.called import FILE
from gsedit.words.instruction import MORE, Change, Instruction, sentence_of
from gsedit.words.read import read_instruction

FINISHES = {"paint": ("glossy", "satin", "matte"), "material": ("polished", "satin", "matte"),
            "finish": ("polished", "glossy", "matte")}  # fmt: skip
"""Words for how rough paint, materials and a finish alone are, from smooth to rough."""
_WORDS = {word for words in FINISHES.values() for word in words}
LEAST = 0.9
"""Largest share that is taken away: nothing at all is another request."""
USUAL = {"growth": (-LEAST, 2.0), "scale": (-0.8, 2.0), "turn": (-0.5, 0.5), "tone": (-LEAST, 1.0)}
"""Ranges of the amounts; see `Change.amount`."""


@dataclass(frozen=True)
class Knob:
    """One amount, color or finish of one change of a sentence."""

    index: int
    """Number of the change in the sentence."""
    kind: Literal["amount", "color", "finish"]
    label: str
    value: float | str
    """Share, "#rrggbb", or a word of `choices` ("" where the sentence says none)."""
    low: float = 0.0
    high: float = 0.0
    choices: tuple[str, ...] = ()
    """Finishes from smooth to rough."""


def knobs_of(instruction: Instruction, read: Callable[[str], Instruction]) -> tuple[Knob, ...]:
    """All that can be turned in a sentence that was read; nothing where its changes have no
    sentence that `read` reads as the same changes."""
    changes = instruction.changes
    wording = sentence_of(changes) if instruction.known else None
    if wording is None or read(wording).changes != changes:
        return ()
    return tuple(knob for i, change in enumerate(changes) for knob in _knobs(i, change))


def turned(instruction: Instruction, knob: Knob, value: float | str) -> str:
    """The sentence with one knob at another value."""
    changes = list(instruction.changes)
    change = changes[knob.index]
    match knob.kind:
        case "amount":
            changes[knob.index] = replace(change, amount=float(value))
        case "color":
            kept = [word for word in change.name.split() if word in _WORDS]
            changes[knob.index] = replace(change, name=" ".join([*kept, str(value)]), color=value)
        case "finish":
            words = [word for word in change.name.split() if word not in _WORDS]
            changes[knob.index] = replace(change, name=" ".join([str(value), *words]).strip())
    sentence = sentence_of(changes)
    assert sentence is not None  # only the value changed
    return sentence


def _knobs(index: int, change: Change) -> list[Knob]:
    found = []
    key = change.name if change.kind == "object" else change.kind
    if key in USUAL and (change.amount is not None or change.kind == "growth"):
        label = {"scale": "size", "turn": "turn", "growth": f"{change.name}: depth"}.get(key)
        if label is None:
            label = " / ".join(reversed(MORE[change.name]))
        amount = min(max(change.amount or 0.0, USUAL[key][0]), USUAL[key][1])
        found.append(Knob(index, "amount", label, amount, *USUAL[key]))
    if change.kind == "paint" and change.color is not None:
        found.append(Knob(index, "color", "color", change.color))
    if words := FINISHES.get("finish" if change.name.endswith(" finish") else change.kind):
        said = next((word for word in words if word in change.name.split()), "")
        found.append(Knob(index, "finish", "roughness", said, choices=words))
    return found


USUAL_COUNT = 148_625
"""Gaussians of the scene whose seconds are below."""
SECONDS = {"tone": 1.0, "paint": 3.5, "material": 4.5, "light": 3.5, "scenery": 3.5, "object": 7.0}
"""Seconds of work by route for a scene of USUAL_COUNT Gaussians on two cores, nothing beside it."""


@dataclass(frozen=True)
class Reading:
    """A sentence as it was understood, for one scene."""

    text: str
    instruction: Instruction
    steps: tuple[Instruction, ...]
    """Edits that it takes; none where it is refused."""
    refusal: Said = field(default=Said(""))
    """Reason why it is refused, with the next move."""

    @property
    def first(self) -> Instruction | None:
        """The first edit, which a preview shows; None where there is none."""
        return self.steps[0] if self.steps else None

    def seconds(self, count: int) -> float:
        """About how long the whole takes on a scene of so many Gaussians."""
        return sum(_seconds(change, count) for change in self.instruction.changes)


def read(
    text: str, names: Iterable[str] = (), places: Places | None = None, *, accept: bool = False
) -> Reading:
    """Understand a sentence; `names` are those of the scene's saved selections. One that names a
    file outside of the places is refused, and with words that were not read, unless to `accept`."""
    instruction = read_instruction(text, tuple(names), accept_unread=accept)
    try:
        if places is not None:
            for name in FILE.findall(text):
                places.check(Path.cwd() / name.strip("\"'"))
        steps = steps_of(instruction)
        for step in steps:
            if not is_exact(step):
                following(editor_2d(), step)
    except UsageError as error:
        return Reading(text, instruction, (), on_page(error))
    return Reading(text, instruction, steps)


@cache
def editor_2d() -> Editor:
    """The painter, which `gsedit edit` asks for what is not done on the Gaussians."""
    return make_editor()


def _seconds(change: Change, count: int) -> float:
    if change.route not in SECONDS:
        return 16.0  # of work of a 2D editor, whatever the size of the scene
    return SECONDS[change.route] * max(count, USUAL_COUNT / 10) / USUAL_COUNT
