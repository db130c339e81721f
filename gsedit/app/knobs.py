"""Amounts and colors of a sentence as things to turn: each turn is another sentence.

So what the sliders do is what the sentence says, and the history holds instructions that a person
can read and repeat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from gsedit.words.instruction import MORE, Change, Instruction, sentence_of

FINISHES = {"paint": ("glossy", "satin", "matte"), "material": ("polished", "satin", "matte")}
"""Words for how rough paint and materials are, from smooth to rough."""
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
    if words := FINISHES.get(change.kind):
        said = next((word for word in words if word in change.name.split()), "")
        found.append(Knob(index, "finish", "roughness", said, choices=words))
    return found
