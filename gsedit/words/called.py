"""Sentences in which saved selections are called by name: a name wins over all lists of words."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace

from gsedit.words import read as reader
from gsedit.words.instruction import Change, Instruction
from gsedit.words.phrases import IT

BEFORE = r"\b(the|this|that|these|those|my|our|your|its|their)\s+"
"""Words after which a name is one: "make it gold" is no call of what was saved as gold."""

WRITTEN = re.compile(r"[_-]|[a-z]\w*\d", re.IGNORECASE)
"""A sign that a name is written as it was saved, "left_leg-2": it needs no word before it."""


def read_called(sentence: str, names: Collection[str]) -> Instruction:
    """The changes that a sentence asks for, in which names of saved selections are things.

    Names are as `gsedit.select.saved.key_of_name` spells them. As `read_instruction` without a
    name in it, and where the reading finds a name in no change.
    """
    called, found = _stood_in(sentence, names)
    if not found:
        return reader.read_instruction(sentence, names)
    read = reader.read_instruction(called, list(found))
    named = " ".join(text for each in read.changes for text in _texts(each))
    if not read.known or any(word not in named for word in found):
        return reader.read_instruction(sentence, names)
    told = tuple(_restored(each, found) for each in read.changes)
    return Instruction(sentence, True, "; ".join(map(str, told)), told)


def _stood_in(sentence: str, names: Collection[str]) -> tuple[str, dict[str, str]]:
    """The sentence with a word that no list has in the place of each name; the names by word."""
    found = dict[str, str]()
    if not names:
        return sentence, found
    longest_first = sorted(names, key=lambda name: (-len(name), name))
    any_name = "|".join(re.escape(name).replace(r"\ ", r"[\s_-]+") for name in longest_first)
    pattern = re.compile(rf"(?:{BEFORE})?(?<![\w-])({any_name})(?![\w-]|\.\w)", re.IGNORECASE)

    def stand_in(match: re.Match[str]) -> str:
        if match[1] is None and not WRITTEN.search(match[2]):
            return match[0]
        name = re.sub(r"[\s_-]+", " ", match[2].lower())
        word = next((w for w, each in found.items() if each == name), f"zq{chr(97 + len(found))}x")
        found[word] = name
        return f"{match[1] or 'the'} {word}"

    return pattern.sub(stand_in, sentence), found


def _texts(change: Change) -> Iterator[str]:
    """The phrases of a change."""
    yield change.phrase
    if change.place is not None:
        yield change.place.of or IT


def _restored(change: Change, found: dict[str, str]) -> Change:
    """A change with the names in place of the words that stood in for them."""

    def renamed(text: str) -> str:
        for word, name in found.items():
            text = text.replace(word, name)
        return text

    place = change.place and replace(change.place, of=renamed(change.place.of))
    return replace(change, phrase=renamed(change.phrase), place=place)
