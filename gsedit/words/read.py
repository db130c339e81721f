"""Reader of a sentence: what is asked, of which things, and what stays.

A network marks the words of each change (gsedit.words.marks), the tables of words tell what they
mean, and checks apart from the network stop what is denied, what stays, and what is not sure.
Loads torch when it reads.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from gsedit.errors import Said
from gsedit.words.called import called
from gsedit.words.direct import LIKE
from gsedit.words.instruction import Change, Instruction, Target
from gsedit.words.lexicon import styles
from gsedit.words.marks.heard import heard
from gsedit.words.phrases import with_base, without_base
from gsedit.words.refusals import Refused, first_refusal, reason
from gsedit.words.written import is_written, written


def read_instruction(
    sentence: str, saved: Collection[str] = (), *, accept_unread: bool = False
) -> Instruction:
    """Changes that a sentence asks for, or why it is refused; checks keep back what it forbids.

    `saved` are names of saved selections, as `gsedit.select.saved.key_of_name` spells them: they
    are things. With `accept_unread` a reading that is not sure is taken. JSON in place of a
    sentence is taken as it is: see `gsedit.words.written`. Loads torch. Raises UsageError for JSON
    that is not changes.
    """
    if is_written(sentence):
        return written(sentence)
    if (bare := without_base(sentence)) != sentence:
        read = read_instruction(bare, saved, accept_unread=accept_unread)
        return with_base(read, sentence)
    if steps := _steps(sentence):
        return Instruction(sentence, True, "; ".join(map(str, steps)), steps)
    try:
        if kind := first_refusal(sentence):
            raise Refused(kind)
        names = called(sentence, saved)
        told = heard(names.text, names.files, accept_unread=accept_unread)
    except Refused as refused:
        return Instruction(sentence, False, reason(refused), (), refused.args[0])
    changes = tuple(map(names.restored, told.changes))
    why = "; ".join(map(str, changes))
    if told.known:
        return Instruction(sentence, True, why, changes)
    why = Said(f"read: {why}; this is not sure. Run it so?", "unread")
    return Instruction(sentence, False, why, (), "unread", (sentence,))


STEP = re.compile(r"(?:(?:all|everything) but )?(.+?) in the style of (.+)")
"""A painted step, as the program calls it."""


def _steps(sentence: str) -> tuple[Change, ...]:
    """Changes of painted steps as the program itself calls them; none for any other sentence."""
    found = list[Change]()
    parts: dict[str, Target] = {"the whole scene": "scene", "the background": "background"}
    for each in sentence.split("; "):
        match = STEP.fullmatch(each)
        if match is None or match[2] not in (*styles(), LIKE):
            return ()
        target = parts.get(match[1], "subject")
        if each.startswith(("all but ", "everything but ")):
            target = "background"
        phrase = "" if match[1] in (*parts, "the subject") else match[1]
        found.append(Change(target, "look", match[2], None, None, "style", phrase))
    return tuple(found)
