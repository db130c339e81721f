"""Looks of the editor `small` that a sentence asks for."""

from __future__ import annotations

from functools import lru_cache

from gsedit.errors import UsageError
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
        raise UsageError(
            f"small does not know {change.phrase!r}: mark it with --region, and say 'it'"
        )
    look = look_of(change)
    if look is None:
        own = "; gsedit does it without a 2D editor: leave the options of editors out"
        able = change.route not in ("small", "pix2pix")
        raise UsageError(
            f"small has no look for {change}{own * able}. For any sentence: --editor pix2pix "
            f"--model FOLDER. {KNOWN}"
        )
    if change.target == "background" or (look.scope == "subject" and change.target == "scene"):
        part = "the subject" if look.scope == "subject" else "the whole picture"
        raise UsageError(
            f"{change}: the look {look.name} of small changes {part}. Ask for it alone, as in "
            f"{look.wording!r}, and mark what may change with --region"
        )
    return look
