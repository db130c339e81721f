"""Phrases that name an object of a scene, also with what it stands on ("the statue and its base"),
and what may not be taken for one. Loads no torch."""

from __future__ import annotations

import re
from dataclasses import replace

from gsedit.words.clauses import DETERMINERS
from gsedit.words.instruction import Change, Instruction
from gsedit.words.lexicon import things
from gsedit.words.scan import Word, scanned

IT = "it"
"""Phrase of the scene's main subject, or of what was named before."""
PRONOUNS, NO_THINGS = frozenset(things("pronoun")), frozenset(things("nothing"))
"""Phrases of what IT is, and words that tell a part of an object, or none."""
NEVER = frozenset(
    ("light", "look", "noun", "style", "turn", "hue", "not", "drop", "except", "keep", "limit",
     "same", "or", "ask", "wish", "do", "be", "touch", "up", "down", "part", "lack", "enough",
     "retract", "simile", "asif", "scene", "rest", "mark", "poss", "conj", "than", "fraction",
     "factor", "unit", "intense", "slight", "strong")
)  # fmt: skip
"""Kinds of words that are in no name of an object."""
HEADS = frozenset(("subject", "ground", "unknown"))
"""Kinds of words that can end the name of an object."""
NOUNS = frozenset(("one", "ones", "two", "three", "thing", "things", "object", "objects"))
RELATION = re.compile(
    r"\b(?:to the |on the |at the )?(left|right|front|top) (?:side )?of\b"
    r"|\b(?:next to|in front of|on top of|beside|near|behind|under|above|below|by|on|in|at|with)\b"
)
"""Words that begin the place by which an object is told from others."""
GROUNDS, CARRIERS = frozenset(things("floor")), frozenset(things("carrier"))
"""Phrases of what everything stands on, and of what carries things, which is seldom the subject."""
DEFINITE = DETERMINERS | {"these", "those"}

NUMBERED = re.compile(r"\b(?:the )?object ?(\d+)\b", re.IGNORECASE)
"""An object by its number, as gsedit select --objects tells it."""


def object_phrase(text: str, *, parts: bool = False) -> str | None:
    """The phrase of an object that words name, "it" for the subject; None where they name none.

    "The red one", "the chair on the left", "bear": a determiner, or a thing of the lexicon. Colors,
    lights, weather and tones are no objects, and parts of things only where `parts` may be.
    """
    text = text.strip()
    if numbered := NUMBERED.fullmatch(text):
        return f"object {numbered[1]}"
    if text in PRONOUNS:
        return IT
    place = RELATION.search(text, 1)
    name = text[: place.start()].strip() if place else text
    words = scanned(name)
    if re.search(r"\d [a-z]", name):
        return None  # "the bear 1 m"; but "the gray 2"
    if not words or (words[0].text not in DEFINITE and words[-1].kind != "subject"):
        return None
    if not _names(words, parts) or (
        place and not _is_place(text[place.start() :], text[place.end() :])
    ):
        return None
    return text


def _names(words: list[Word], parts: bool) -> bool:
    """Whether words are the name of an object, its place left out."""
    head = words[-1]
    known = head.kind in HEADS or (parts and head.kind == "part")
    words_of = words[:-1] if head.kind == "part" and parts else words
    barred = any(word.kind in NEVER or NO_THINGS & set(word.text.split()) for word in words_of)
    return (known or head.text in NOUNS) and not barred and len(words) > (head.text in NOUNS)


def _is_place(place: str, of: str) -> bool:
    """Whether words are a place: "on the left", "next to the chair"."""
    kinds = {word.kind for word in scanned(place)}
    told = kinds <= {"direction", "fill", "behind", "background", "ground"} and kinds != {"fill"}
    return told or object_phrase(of) is not None


def is_noun(phrase: str) -> bool:
    """Whether a phrase is the noun of a thing alone, as "the bear": only a network finds that."""
    words = [word for word in scanned(phrase) if word.text not in DEFINITE]
    ranked = words[-1].text.endswith(("est", "most"))  # "the largest"
    return len(words) == 1 and words[0].kind in ("subject", "unknown") and not ranked


BASED = "it with its base"
"""Phrase of the subject with what it stands on."""
_BASE = r"(?:base|plinth|pedestal|stand|socle|slab|rock|stone|support)"
WITH_BASE = re.compile(
    rf",? (?:and|with|plus|including|along with|together with) (?:its|his|her|their) {_BASE}\b"
    rf"|,? (?:with|including|along with|together with) the {_BASE}\b",
    re.IGNORECASE,
)


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
