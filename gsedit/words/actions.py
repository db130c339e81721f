"""Actions on objects that a sentence asks for, in order with its other changes.

A clause is an action only if all of its words say one; every other clause is left to the reader of
looks. Where a sentence has an action, nothing in it may deny. Loads no torch.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches

from gsedit.formats.registry import READABLE
from gsedit.words.chosen import parted
from gsedit.words.deeds import change_of, side_of
from gsedit.words.instruction import Change
from gsedit.words.phrases import DEFINITE, IT, PRONOUNS, object_phrase
from gsedit.words.refusals import Refused
from gsedit.words.scan import scanned

SUFFIX = rf"(?:{'|'.join(map(re.escape, READABLE))})\b"
FILE = re.compile(rf"\"[^\"]+{SUFFIX}\"|'[^']+{SUFFIX}'|[^\s\"',;]+{SUFFIX}", re.IGNORECASE)
"""A scene's file in a sentence; one with spaces in its name is in quotes."""
BREAK = re.compile(
    r"(?<!\S)(?:[,;.!?\n]|and then|and also|and(?! a half)|then|after that|afterwards)(?!\S)"
)
STOP = re.compile(r"(?<!\S)[;.!?\n](?!\S)")
"""Mark that ends a sentence."""
REQUEST = re.compile(
    r"(?:(?:please|pls|now|first|next|finally|just|hey|hi|ok|okay|kindly|let us|also"
    r"|(?:can|could|would|will) (?:you|we|u)|(?:i|we) (?:want|need|would like) (?:you )?to"
    r"|try to) )+"
)
THANKS = re.compile(
    r"(?: (?:please|pls|thanks|thank you|now|for me|again|too|as well|completely|entirely"
    r"|altogether|if (?:you can|possible)))+$"
)
COURTESY = frozenset(("please", "thanks", "thank you", "ok", "okay", "hi", "hey", "hello"))
DENIALS = frozenset(("not", "retract", "keep", "limit", "same", "except", "or", "asif"))
"""Kinds of words that no other clause may have beside an action."""
LATER = ("then", "and then", "after that", "afterwards")
"""Conjunctions that begin another request."""
QUALITIES = frozenset(
    ("turn", "state", "color", "material", "finish", "slight", "strong", "degree", "up", "down",
     "conj", "mark", "fill", "number", "unit", "hue")
)  # fmt: skip
"""Kinds of words that say what something becomes, without a verb or a thing."""
OTHERS = frozenset(("background", "ground", "place", "rest", "scene"))
"""Kinds of words for what is not the subject."""
ASKS = frozenset(("do", "wish", "be", "up", "down", "turn", "touch"))
"""Kinds of words of which a look that follows an action must have one."""
SPELT = (
    "remove", "delete", "erase", "rotate", "bigger", "larger", "smaller", "enlarge", "shrink",
    "double", "triple", "duplicate",
)  # fmt: skip
"""Words of actions that are recognized with a slip of spelling."""
MADE = {"copy": "the copy"}
"""Phrase of what an action made; that of an insert is its file."""


@dataclass(frozen=True)
class Piece:
    """One clause of a sentence as text, and its place in it."""

    start: int
    end: int
    text: str
    """Text without words of courtesy."""
    is_question: bool
    """Whether it asks for an answer, not for something to be done."""


@dataclass(frozen=True)
class OtherClauses:
    """Text between actions on objects, left to the reader of looks."""

    text: str
    it: str
    """Phrase that "it" stands for in them; "it" for the subject."""
    goes_on: bool = False
    """Whether they only say what else it becomes: "make it bigger and brighter"."""


def actions_of(text: str) -> list[Change | OtherClauses] | None:
    """Changes of objects in order, with the clauses between them; None for no action.

    Raises Refused for an action beside what is denied, or for one that cannot be done.
    """
    text = " ".join(map(_spelt, text.split()))
    found, last = list[Change | str](), Piece(0, 0, "", False)
    for clause in _clauses(text):
        change = _action(clause, found)
        if change is None and found and isinstance(found[-1], str):
            last = replace(last, end=clause.end)
            found[-1] = text[last.start : last.end]
        elif change is None or not _joined(found, change):
            found.append(change or text[clause.start : clause.end])
            last = clause
    if not any(isinstance(each, Change) for each in found):
        return None
    _refuse_others(found)
    return list(_linked(found))


def _spelt(word: str) -> str:
    """A word of an action for one with a slip of spelling; any other word as it is."""
    known = [each for each in SPELT if each[0] == word[0] and not word.startswith(each)]
    if len(word) < 5 or not known or scanned(word)[0].kind != "unknown":
        return word
    return next(iter(get_close_matches(word, known, n=1, cutoff=0.85)), word)


def _clauses(text: str) -> Iterator[Piece]:
    """Clauses between marks and conjunctions."""
    start, last, requested = 0, "", False
    for match in [*BREAK.finditer(text), None]:
        end = len(text) if match is None else match.start()
        plain = THANKS.sub("", f" {text[start:end].strip().removeprefix(last).strip()}").strip()
        last = "" if match is None else match[0]
        request = REQUEST.match(plain)
        requested |= request is not None
        stop = STOP.search(text, end)
        asks = stop is not None and stop[0] == "?" and not requested
        if plain and plain not in COURTESY:
            yield Piece(start, end, plain[request.end() :] if request else plain, asks)
        if match is not None:
            start = match.start() if match[0] in LATER else match.end()
            requested &= not STOP.fullmatch(match[0])


def _action(clause: Piece, found: list[Change | str]) -> Change | None:
    """The action of a clause after others; None for a clause about something else."""
    before = found[-1] if found else None
    if clause.is_question:
        return None
    change = change_of(clause.text)
    if isinstance(before, str) and change and change.phrase == IT:
        kinds = {word.kind for word in scanned(before)}
        if "noun" in kinds or not kinds & ASKS - {"be"} or change.name == "remove":
            return None  # "the brightness is bad, move it up"; "there is snow on it, remove it"
        if kinds & OTHERS and not PRONOUNS & set(clause.text.split()):
            return None  # "make the ground darker and bigger"
    if change is None and isinstance(before, Change) and before.name == "remove":
        phrase = object_phrase(clause.text)  # "remove the bear and the table"
        return replace(before, phrase=phrase) if phrase not in (None, IT) else None
    return change


def _joined(found: list[Change | str], change: Change) -> bool:
    """Whether an action only says where what was just made belongs: "copy it and put it there"."""
    before = found[-1] if found else None
    if not isinstance(before, Change) or before.name not in ("copy", "insert"):
        return False
    if change.name != "move" or change.phrase != IT or change.amount or not change.place:
        return False
    side, made = change.place.side, before.name == "insert"
    place = change.place if change.place.of else side_of(side, IT if made else before.phrase)
    if place is None:
        return False
    of = before.phrase if place.of == IT and not made else place.of
    found[-1] = replace(before, place=replace(place, of=of))
    return True


def _refuse_others(found: list[Change | str]) -> None:
    """Raise Refused for clauses beside an action that deny, or that say nothing to be done."""
    for before, text in zip([None, *found], found):
        if isinstance(text, Change):
            continue
        kinds = {word.kind for word in scanned(text)}
        if kinds & DENIALS:
            raise Refused("negation")
        then = text.startswith(LATER) and not DEFINITE & set(text.split())
        bare = not (kinds & ASKS or then or _goes_on(before, text))
        if isinstance(before, Change) and bare:
            raise Refused("negation")  # "remove the bear and the fog"


def _linked(found: list[Change | str]) -> Iterator[Change | OtherClauses]:
    """Changes in which "it" is what was named or made last."""
    last = IT
    for before, each in zip([None, *found], found):
        if isinstance(each, str):
            yield OtherClauses(each, last, _goes_on(before, each))
            last = next((phrase for _, phrase in reversed(parted(each)) if phrase), "") or last
            continue
        change = replace(each, phrase=last) if each.phrase == IT else each
        if change.name == "copy" and change.place and change.place.of == IT:
            change = replace(change, place=replace(change.place, of=last))
        yield change
        last = MADE.get(change.name, change.phrase or last)


def _goes_on(before: Change | str | None, text: str) -> bool:
    """Whether words after an action only say what else its object becomes."""
    stays = isinstance(before, Change) and before.name != "remove" and before.kind == "object"
    words = scanned(text)
    return stays and all(w.kind in QUALITIES and w.text not in DEFINITE for w in words)
