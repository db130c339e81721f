"""Steps of an edit: changes on the Gaussians, and styles that the painter draws, in order.

Loads no torch.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import groupby

from gsedit.errors import UsageError
from gsedit.paper.settings import EditSettings
from gsedit.words.instruction import Change, Instruction
from gsedit.words.phrases import GROUNDS, owned
from gsedit.words.read import read_instruction
from gsedit.words.refusals import no_style

EXACT_ROUTES = ("tone", "paint", "material", "light", "scenery", "object")
"""Routes that change the Gaussians themselves."""
HEEDED = ("region", "execution")
"""Settings that exact routes heed; any other one is for what a 2D editor draws."""
STYLE = "style"
"""Route of a painting style, which the painter draws in its part of the scene."""
PICTURE = "picture"
"""Route of a sentence that a 2D editor gets as it is."""
COPY = "copy"
PLACED = {"scale", "turn", "move"}
"""Changes that one placement can do together."""
MADE = "the copy"
"""Key of what the last copy made, as `gsedit.words.marks.meaning` names it."""


def is_exact(instruction: Instruction) -> bool:
    """Whether every change of an understood instruction has a route that does it exactly."""
    changes = instruction.changes
    return instruction.known and bool(changes) and all(c.route in EXACT_ROUTES for c in changes)


def asks_editor_2d(settings: EditSettings) -> bool:
    """Whether settings differ from the defaults where only a 2D editor heeds them."""
    usual = EditSettings()
    return replace(settings, **{name: getattr(usual, name) for name in HEEDED}) != usual


def read_steps(
    sentence: str, names: Collection[str] = (), *, drawn: bool = False, accept_unread: bool = False
) -> tuple[Instruction, ...]:
    """Steps of a sentence, in order; a single one with the sentence as it is where all is `drawn`.

    `names` are those of saved selections; with `accept_unread` words that nothing was made of stop
    nothing. Raises UsageError as `steps_of` does.
    """
    if not drawn:
        return steps_of(read_instruction(sentence, names, accept_unread=accept_unread))
    change = Change("scene", "look", PICTURE, None, None, PICTURE)
    return (Instruction(sentence, True, "", (change,)),)


def steps_of(instruction: Instruction) -> tuple[Instruction, ...]:
    """Steps that an instruction takes, in order; itself where exact routes do all.

    Changes beside each other that exact routes do are one step, and so are styles beside each other
    of one part, which are mixed. Raises UsageError for an instruction that is refused, and for a
    look that nothing here draws.
    """
    if not instruction.known:
        raise UsageError(instruction.why)
    changes = tuple(map(owned, instruction.changes))
    if lost := next((c for c in changes if c.route not in (*EXACT_ROUTES, STYLE)), None):
        raise UsageError(no_style(lost.name))
    if is_exact(instruction):
        return (replace(instruction, changes=changes),)
    groups = groupby(changes, lambda each: "" if each.route in EXACT_ROUTES else key_of(each))
    steps = [tuple(group) for _, group in groups]
    told = ["; ".join(map(str, step)) for step in steps]
    left = (instruction.unread, *((),) * len(steps))
    return tuple(
        Instruction(text, True, text, step, unread=each)
        for text, step, each in zip(told, steps, left)
    )


def runs_of(step: Instruction) -> Iterator[tuple[Change, ...]]:
    """Groups of an exact step's changes that are done at once: what is moved, turned and scaled
    together leaves one hole."""
    run: tuple[Change, ...] = ()
    for change in step.changes:
        if run and not _joins(run, change):
            yield run
            run = ()
        run = (*run, change)
    yield run


def _joins(run: Sequence[Change], change: Change) -> bool:
    """Whether a change places what a run of changes does, in a way that it does not yet."""
    first, names = run[0], {each.name for each in run}
    made = {COPY: MADE, "insert": first.phrase}.get(first.name, key_of(first))
    ways = {"insert": {"turn"}, COPY: PLACED, **dict.fromkeys(PLACED, PLACED)}.get(
        first.name, set()
    )
    placed = first.name == COPY and change.place is not None and bool(change.place.of)
    return change.name in ways - names and key_of(change) == made and not placed


LEVEL = ("leaves",)
"""Growths that lie on what is level only: their ground is all but the subject, stones too."""


def key_of(change: Change) -> str:
    """Name of what changes: its phrase, or its target, without what it keeps; PICTURE for what a
    2D editor will tell."""
    return " but not ".join((_whole_of(change), *change.keep))


def _whole_of(change: Change) -> str:
    """Name of what changes, with what it keeps."""
    if change.route == PICTURE:
        return PICTURE
    if change.name in LEVEL and change.phrase in GROUNDS:
        return "background"
    if change.target == "background" and change.phrase not in ("", "it"):
        return f"all but {change.phrase}"
    alone = change.phrase in ("", "it") or change.name == "insert"
    return change.target if alone else change.phrase
