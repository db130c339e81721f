"""Painting styles that a sentence asks for. Loads no torch."""

from __future__ import annotations

from gsedit.errors import UsageError
from gsedit.words import lexicon
from gsedit.words.read import read_instruction
from gsedit.words.refusals import no_style
from gsedit.words.scan import scanned


def styles_asked(sentence: str) -> tuple[str, ...]:
    """Names of the styles that a sentence asks for, to be mixed; `LIKE` for that of a picture that
    is given beside the sentence.

    Raises UsageError for a sentence that asks for something else, styles of several parts, or is
    refused.
    """
    read = read_instruction(sentence)
    told = [each.rpartition(" in the style of ")[2] for each in sentence.split("; ")]
    denied = any(word.kind in ("not", "drop") for word in scanned(sentence))
    if not read.known and not denied and lexicon.styles().keys() >= set(told):
        return tuple(told)  # of a part whose name only the scene knows
    if not read.known:
        raise UsageError(f"{sentence.strip()!r}: {read.why}")
    others = [change for change in read.changes if change.route != "style"]
    if others and others[0].route == "pix2pix":
        raise UsageError(no_style(others[0].name))
    if others:
        raise UsageError(
            f"{others[0]}: this is no painting style, and is done without a 2D editor: leave "
            "--editor out"
        )
    if len({change.part for change in read.changes}) > 1:
        raise UsageError(f"{sentence.strip()!r} asks for styles of several parts: say one part")
    return tuple(dict.fromkeys(change.name for change in read.changes))
