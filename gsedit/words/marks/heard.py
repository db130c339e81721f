"""Reading of a sentence by what the network marks in it. Loads torch when it reads."""

from __future__ import annotations

from collections.abc import Sequence

from gsedit.errors import Said
from gsedit.words.instruction import Instruction
from gsedit.words.marks.checks import denied, stays_unheard, unsure
from gsedit.words.marks.marked import marked
from gsedit.words.marks.meaning import changes_of
from gsedit.words.refusals import Refused, reason

REFUSED = 0.5
"""Least probability that nothing can be done."""


def by_marks(sentence: str, text: str, files: Sequence[str], *, accept_unread: bool) -> Instruction:
    """Changes that the network marks in a text, which is the sentence without its `files`; or why
    it is refused, as where it is not sure and that is not accepted."""
    said = marked(text)
    try:
        if denied(said):
            raise Refused("negation")
        if said.refused > REFUSED or not said.asked:
            raise Refused("nonsense")
        changes = tuple(changes_of(said, files))
        if not said.kept and (stopped := stays_unheard(text, changes)):
            raise Refused("kept", stopped)
    except Refused as refused:
        return Instruction(sentence, False, reason(refused), (), refused.args[0])
    told = "; ".join(map(str, changes))
    if unsure(said) and not accept_unread:
        why = Said(f"read: {told}; this is not sure. Run it so?", "unread")
        return Instruction(sentence, False, why, (), "unread", (sentence,))
    return Instruction(sentence, True, told, changes)
