"""One thing among others that a look is for: "the red one", "the left ball", a saved name.

Its words are not read as a look: "the subject" stands in their place. Loads no torch.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace

from gsedit.words.clauses import CONTENT, NEGATIONS
from gsedit.words.instruction import Change
from gsedit.words.lexicon import things
from gsedit.words.phrases import DEFINITE, IT, NOUNS, RELATION, object_phrase
from gsedit.words.refusals import Refused
from gsedit.words.scan import MARKS, Word, scanned, tokens

Parse = Callable[[list[Word]], list[Change]]
"""Reads the changes that words name."""
DENIALS = NEGATIONS | {"except", "keep", "limit", "down"}
"""Kinds of words after which a name is not what is asked for."""
LONGEST = 12
"""Most words of a phrase."""
SUBJECT = ("the", "subject")
TELLING = frozenset(things("telling"))
"""Words for a size or a place."""
THINGS = frozenset(("subject", "background", "scene", "ground"))
"""Kinds of words that name something else than the last phrase does."""
LOOSE = re.compile(r"\b(?:with|in|at|by)\b")
"""Relations that are also said of a look: "the bear in the rain"."""
COUNTED = re.compile(r"from the (?:left|right|front|back)\b")
"""Sides from which "the second" is counted."""
ORDINALS = frozenset(things("ordinal"))
BREAKS = MARKS | {"and", "then"}
LIKE = frozenset(("as", "like", "than"))
"""Words after which a thing is only brought up."""


def parted(text: str, saved: Collection[str] = (), *, nouns: bool = False) -> list[tuple[str, str]]:
    """Parts of a text, each with the phrase in whose place it has "the subject"; "" without one.

    A part ends where another thing is named. Empty for a text without such a phrase; `saved` are
    names, in small letters, that are phrases too, and with `nouns` so is "the bear".
    """
    parts, idle = list[tuple[str, str]](), False
    for words in _clauses(tokens(text)):
        replaced, phrase, kinds = _replaced(words, saved, nouns)
        joined = " ".join(replaced)
        if parts and (idle or not (phrase or kinds & THINGS)):
            before, told = parts.pop()
            joined, phrase = f"{before} {joined}", phrase or told
        parts.append((joined, phrase))
        idle = not (phrase or kinds & (THINGS | CONTENT))
    return parts if any(phrase for _, phrase in parts) else []


def _clauses(words: list[str]) -> Iterator[list[str]]:
    """Words up to each mark or conjunction, which begins the next clause."""
    start = 0
    for at in range(1, len(words) + 1):
        if at == len(words) or (words[at] in BREAKS and words[at - 1] not in BREAKS):
            yield words[start:at]
            start = at


def _replaced(
    words: list[str], saved: Collection[str], nouns: bool
) -> tuple[list[str], str, set[str]]:
    """The words with "the subject" for the first phrase, the phrase, and the kinds of all words."""
    kinds = {word.kind for word in scanned(" ".join(words))}
    for at, word in enumerate(words):
        if word in LIKE:
            break
        if word == "object" and "".join(words[at + 1 : at + 2]).isdecimal():
            start = at - (words[at - 1 : at] == ["the"])
            return [*words[:start], *SUBJECT, *words[at + 2 :]], f"object {words[at + 1]}", kinds
        if word in DEFINITE and (end := _end(words, at, saved, nouns)):
            return [*words[:at], *SUBJECT, *words[end:]], " ".join(words[at:end]), kinds
    return words, "", kinds


def _end(words: list[str], start: int, saved: Collection[str], nouns: bool) -> int:
    """Place after the longest phrase that begins at a word and tells a thing apart; 0 for none."""
    for end in range(min(len(words), start + LONGEST), start + 1, -1):
        phrase, after = " ".join(words[start:end]), " ".join(words[end:])
        last = scanned(words[end - 1])[0]
        idle = last.kind == "fill" or "from" in words[start:end] or last.text.endswith("ing")
        if (idle and last.text not in NOUNS) or after.startswith(("of ", "'s")):
            continue
        if " ".join(words[start + 1 : end]) in saved:
            return end
        if object_phrase(phrase) not in (None, IT) and (
            tells(phrase) or (nouns and not _is_ground(phrase))
        ):
            counted = COUNTED.match(after) if ORDINALS & set(words[start:end]) else None
            return end + (3 if counted else 0)
    return 0


def tells(phrase: str) -> bool:
    """Whether a phrase has a color, size, place or relation that tells a thing from others."""
    place = RELATION.search(phrase, 1)
    words = scanned(phrase[: place.start()] if place else phrase)
    if _is_ground(phrase):
        return False  # "the green grass" is the ground
    if place and not LOOSE.match(place[0]):
        return True
    return any(_tells(word, words[-1]) for word in words)


def _is_ground(phrase: str) -> bool:
    place = RELATION.search(phrase, 1)
    return scanned(phrase[: place.start()] if place else phrase)[-1].kind == "ground"


def _tells(word: Word, head: Word) -> bool:
    thing = head.kind != "subject" or head.text in NOUNS  # "the golden statue" may be the subject
    colored = word.kind == "color" or (thing and word.color is not None)
    return colored or bool(TELLING & set(word.text.split()))


def looks_of(
    text: str, saved: Collection[str], parse: Parse, *, nouns: bool = False
) -> list[Change]:
    """Changes that words name, each with the phrase of what it is for. Raises Refused."""
    words, parts = scanned(text), parted(text, saved, nouns=nouns)
    if not parts:
        return parse(words)
    if len(parts) > 1 and any(word.kind in DENIALS for word in words):
        raise Refused("negation")
    try:
        changes = [_chosen(part, phrase, parse) for part, phrase in parts]
    except Refused:
        changes = [[]]
    if all(changes):
        return [change for some in changes for change in some]
    if len(parts) > 1:
        raise Refused("part")
    asked = parse(words)  # "I want the red bear" names what it should be
    if any(c.kind != "paint" for c in asked):
        raise Refused("part")
    return asked


def _chosen(text: str, phrase: str, parse: Parse) -> list[Change]:
    """Changes of a part of a sentence in which "the subject" is what a phrase names."""
    words = scanned(text)
    changes = parse(words)
    if not phrase:
        return changes
    others = any(word.kind in ("rest", "except") for word in words)
    lit = all(c.target == "scene" and c.kind in ("light", "look") for c in changes)
    if lit and not others:
        return [replace(c, target="subject", phrase=phrase) for c in changes]
    meant = ("subject", "background") if others else ("subject",)
    return [replace(c, phrase=phrase) if c.target in meant else c for c in changes]
