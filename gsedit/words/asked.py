"""Looks of the editor `small` that a sentence asks for."""

from __future__ import annotations

from functools import lru_cache

from gsedit.errors import Said, UsageError
from gsedit.words.instruction import Change
from gsedit.words.looks import LOOKS, Look, look_of
from gsedit.words.read import read_instruction

KNOWN = f"small knows the looks {', '.join(LOOKS)}"
"""End of a refusal: everything that may be asked for."""


@lru_cache(64)
def looks_asked(sentence: str) -> tuple[Look, ...]:
    """The looks that a sentence asks for, the subject's first.

    Raises UsageError for one that is refused as it is read, and where `small` has no look for it.
    """
    read = read_instruction(sentence)
    if not read.known:
        known = f". {KNOWN}" if read.refusal in ("nonsense", "geometry") else ""
        raise UsageError(f"{sentence.strip()!r}: {read.why}{known}")
    looks = dict.fromkeys(_look_for(change) for change in read.changes)
    return tuple(sorted(looks, key=lambda look: look.scope == "scene"))


def _look_for(change: Change) -> Look:
    """The look that does a change. Raises UsageError, with the next move, where none does."""
    if change.phrase not in ("", "it"):
        raise UsageError(Said(f"small does not know {change.phrase!r}", "select"))
    look = look_of(change)
    if look is None:
        able = change.route not in ("small", "pix2pix")
        move = "looks-exact" if able else "looks"
        raise UsageError(Said(f"small has no look for {change}. {KNOWN}", move))
    if change.target == "background" or (look.scope == "subject" and change.target == "scene"):
        part = "the subject" if look.scope == "subject" else "the whole picture"
        what = f"{change}: the look {look.name} of small changes {part}"
        raise UsageError(Said(f"{what}. Ask for it alone, as in {look.wording!r}", "select-too"))
    return look
