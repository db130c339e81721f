"""Reader of a sentence: what is asked, of which things, and what stays.

A network marks the words of each change (gsedit.words.marks), the tables of words tell what they
mean, and checks apart from the network stop what is denied, what stays, and what is not sure.
Loads torch when it reads.
"""

from __future__ import annotations

from collections.abc import Collection

from gsedit.errors import Said
from gsedit.words.called import called
from gsedit.words.instruction import Instruction
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
    try:
        if kind := first_refusal(sentence):
            raise Refused(kind)
        names = called(sentence, saved)
        changes, sure, left = heard(names.text, names.files)
    except Refused as refused:
        return Instruction(sentence, False, reason(refused), (), refused.args[0])
    changes = tuple(map(names.restored, changes))
    why = "; ".join(map(str, changes))
    if sure or accept_unread:
        return Instruction(sentence, True, why, changes, unread=left)
    why = Said(f"read: {why}; this is not sure. Run it so?", "unread")
    return Instruction(sentence, False, why, (), "unread", (sentence,))
