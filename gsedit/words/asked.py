"""Looks of the editor `small` that a sentence asks for: read first, and refused as it is read."""

from __future__ import annotations

from functools import lru_cache

from gsedit.errors import Said
from gsedit.words.instruction import Change
from gsedit.words.looks import Look
from gsedit.words.read import read_instruction
from gsedit.words.small_looks import look_of
from gsedit.words.understanding import ScoredLook, Understanding

GUESSED = ("nonsense", "geometry")
"""Kinds of refusal in whose place the nearest look may be guessed; nothing else that is refused
may be."""


@lru_cache(64)
def looks_asked(sentence: str) -> Understanding:
    """Looks that a sentence asks for; not known, with the reason, where `small` has none for it.

    Raises InputError where the files of the encoder are missing or damaged.
    """
    read = read_instruction(sentence)
    if read.refusal in GUESSED:
        from gsedit.words.reader import understand

        return Understanding(understand(sentence).looks, False, read.why)
    if not read.known:
        return Understanding((), False, read.why)
    looks = [look_of(change) for change in read.changes]
    for change, look in zip(read.changes, looks):
        if why := _unfit(change, look):
            return Understanding((), False, why)
    known = [look for look in looks if look]
    known.sort(key=lambda look: look.scope == "scene")
    scored = dict.fromkeys(ScoredLook(look.name, 1.0) for look in known)
    return Understanding(tuple(scored), True, str(read))


def _unfit(change: Change, look: Look | None) -> str:
    """Why a look of `small` does not do a change; "" where it does."""
    if change.phrase not in ("", "it"):
        return Said(f"small does not know {change.phrase!r}", "select")
    if look is None:
        able = change.route not in ("small", "pix2pix")
        return Said(f"small has no look for {change}", "looks-exact" if able else "looks")
    if change.target == "background" or (look.scope == "subject" and change.target == "scene"):
        part = "the subject" if look.scope == "subject" else "the whole picture"
        what = f"{change}: the look {look.name} of small changes {part}"
        return Said(f"{what}. Ask for it alone, as in {look.wording!r}", "select-too")
    return ""
