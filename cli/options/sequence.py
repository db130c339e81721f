"""Sentences whose changes take several routes: one edit after the other."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

from .editing import EditorOptions
from .routes import heeds_routes
from .settings import Values

if TYPE_CHECKING:
    from gsedit.words.instruction import Instruction

STEPS = "steps"
"""Folder, in that of the edit, with the folders of all edits but the last."""


def steps_of(text: str, editor: EditorOptions, values: Values) -> list[Instruction]:
    """Return the edits that a sentence takes, in order: none unless it takes several.

    Changes beside each other that exact routes do are one edit, and so are looks of the 2D editor.
    """
    if not heeds_routes(editor, values):
        return []
    from gsedit.editing.routes.apply import EXACT_ROUTES
    from gsedit.words.instruction import Instruction
    from gsedit.words.read import read_instruction
    from gsedit.words.small_looks import look_of

    changes = read_instruction(text).changes
    groups = [tuple(each) for _, each in groupby(changes, lambda c: c.route in EXACT_ROUTES)]
    if len(groups) < 2:
        return []
    steps = []
    for group in groups:
        if group[0].route in EXACT_ROUTES:
            words = "; ".join(map(str, group))
        else:
            looks = [look_of(change) for change in group]
            if None in looks:
                return []  # the 2D editor says what it cannot follow
            words = " and ".join(look.wording for look in looks if look is not None)
        steps.append(Instruction(words, True, words, group))
    return steps
