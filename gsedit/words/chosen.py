"""Things that looks are for: text is read up to where another thing is named. Loads no torch."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

from gsedit.words.clauses import CONTENT
from gsedit.words.instruction import Change
from gsedit.words.refusals import Refused
from gsedit.words.scan import MARKS, STAND_IN, Word, scanned

Parse = Callable[[list[Word]], list[Change]]
"""Reads the changes that words name."""
THINGS = frozenset(("background", "scene"))
"""Kinds of words that name something else than the last phrase does."""
BREAKS = MARKS | {"and", "then", "but", "while"}


def parted(text: str) -> list[tuple[str, str]]:
    """Parts of a text, each with the phrase that it is about; "" where it names no thing.

    A part ends where another thing is named.
    """
    parts, idle = list[tuple[str, str]](), False
    if len(found := set(re.findall(STAND_IN, text))) < 2 and not (
        found and THINGS & {w.kind for w in scanned(text)}
    ):
        return [(text, f"the {found.pop()}" if found else "")]
    for words in _clauses(text.split()):
        joined = " ".join(words)
        found = list(dict.fromkeys(re.findall(STAND_IN, joined)))
        kinds = {word.kind for word in scanned(joined)}
        phrase = f"the {found[0]}" if found else ""
        if parts and (idle or not (phrase or kinds & THINGS)):
            before, told = parts.pop()
            joined, phrase = f"{before} {joined}", phrase or told
        parts.append((joined, phrase))
        idle = not kinds & CONTENT
    return parts


def _clauses(words: list[str]) -> Iterator[list[str]]:
    """Words up to each mark or conjunction, which begins the next clause."""
    start = 0
    for at in range(1, len(words) + 1):
        if at == len(words) or (words[at] in BREAKS and words[at - 1] not in BREAKS):
            yield words[start:at]
            start = at


def looks_of(text: str, parse: Parse) -> list[Change]:
    """Changes that a text names, each with the phrase of what it is for. Raises Refused."""
    parts = parted(text)
    if len(parts) < 2:
        return _chosen(text, parts[0][1] if parts else "", parse)
    found = [_chosen(part, phrase, parse) for part, phrase in parts]
    if not all(found):
        raise Refused("nonsense")
    return [change for some in found for change in some]


def _chosen(text: str, phrase: str, parse: Parse) -> list[Change]:
    """Changes of a part of a sentence, those of the subject being of what a phrase names."""
    changes = parse(scanned(text))
    if not phrase:
        return changes
    return [replace(c, phrase=phrase) if c.target == "subject" else c for c in changes]
