"""Order of an edit: changes on the Gaussians and changes that a 2D editor draws take turns."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

from gsedit.editing.routes.apply import EXACT_ROUTES
from gsedit.editing.session.settings import EditSettings
from gsedit.errors import UsageError
from gsedit.words.direct import UNCLEAR
from gsedit.words.instruction import Instruction
from gsedit.words.looks import look_of

HEEDED = ("region", "execution")
"""Settings that exact routes heed; any other one asks for the 2D editor."""


def asks_editor_2d(settings: EditSettings) -> bool:
    """Whether settings differ from the defaults where only the 2D editor heeds them."""
    usual = EditSettings()
    return replace(settings, **{name: getattr(usual, name) for name in HEEDED}) != usual


def steps_of(instruction: Instruction) -> tuple[Instruction, ...]:
    """Edits that an instruction takes, in order; itself where it takes one.

    Changes beside each other that exact routes do are one edit, and so are looks of the 2D editor.
    Raises UsageError for an instruction that is refused, and for a look that `small` hardly draws,
    or beside other changes does not draw.
    """
    if not instruction.known:
        raise UsageError(instruction.why)
    changes = instruction.changes
    if unclear := next((change.name for change in changes if change.name in UNCLEAR), None):
        raise UsageError(
            f"{instruction.text!r}: there is no look {unclear!r} that is done on the Gaussians: "
            "--editor small draws its own, --editor pix2pix --model FOLDER follows any sentence"
        )
    drawn = [each for each in changes if each.phrase and each.route not in EXACT_ROUTES]
    if drawn:
        raise UsageError(
            f"{drawn[0]}: a 2D editor knows no phrases: mark it with --region, and say 'it'"
        )
    groups = [tuple(each) for _, each in groupby(changes, lambda c: c.route in EXACT_ROUTES)]
    if len(groups) < 2:
        return (instruction,)
    steps = []
    for group in groups:
        if group[0].route in EXACT_ROUTES:
            words = "; ".join(map(str, group))
        else:
            looks = [look_of(change) for change in group]
            if None in looks:
                raise UsageError(
                    f"{group[looks.index(None)]}: small does not draw this (gsedit list looks): "
                    "leave it out, or do it alone with --editor pix2pix --model FOLDER"
                )
            words = " and ".join(look.wording for look in looks if look is not None)
        steps.append(Instruction(words, True, words, group))
    return tuple(steps)
