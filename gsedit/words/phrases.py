"""Phrases that name an object of a scene, also with what it stands on ("the statue and its base"),
and what may not be taken for one. Loads no torch."""

from __future__ import annotations

from dataclasses import replace

from gsedit.words.instruction import Change, Instruction
from gsedit.words.lexicon import pattern, things
from gsedit.words.scan import DETERMINERS, scanned

IT = "it"
"""Phrase of the scene's main subject, or of what was named before."""
PRONOUNS = frozenset(things("pronoun"))
"""Phrases of what IT is."""
GROUNDS, CARRIERS = frozenset(things("floor")), frozenset(things("carrier"))
"""Phrases of what everything stands on, and of what carries things, which is seldom the subject."""
DEFINITE = DETERMINERS | {"these", "those"}


def is_noun(phrase: str) -> bool:
    """Whether a phrase is the noun of a thing alone, as "the bear": only a network finds that."""
    words = [word for word in scanned(phrase) if word.text not in DEFINITE]
    ranked = words[-1].text.endswith(("est", "most"))  # "the largest"
    return len(words) == 1 and words[0].kind in ("subject", "unknown") and not ranked


QUALITY = pattern("quality")
"""A quality that stays, with whose it is: "the cake's brightness", "the shadows"."""


def owned(change: Change) -> Change:
    """A change of which things stay whose qualities do; qualities of no thing do by themselves."""
    keep = tuple(filter(None, (QUALITY.sub("", each) for each in change.keep)))
    phrase = QUALITY.sub("", change.phrase) if change.target == "background" else change.phrase
    return replace(change, phrase=phrase, keep=keep)


BASED = "it with its base"
"""Phrase of the subject with what it stands on."""
WITH_BASE = pattern("based")


def without_base(sentence: str) -> str:
    """The sentence without words that add to the subject what it stands on."""
    return WITH_BASE.sub("", sentence)


def with_base(read: Instruction, sentence: str) -> Instruction:
    """The reading of `without_base(sentence)`, for the subject with what it stands on."""
    changes = tuple(map(_based, read.changes))
    why = "; ".join(map(str, changes)) if read.known else read.why
    return replace(read, text=sentence, why=why, changes=changes)


def _based(change: Change) -> Change:
    is_subject = change.phrase in ("", IT) or is_noun(change.phrase)
    return replace(change, phrase=BASED) if change.target == "subject" and is_subject else change
