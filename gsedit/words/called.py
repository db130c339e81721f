"""Names and files in a sentence that no reader of English knows, as plain nouns. Loads no torch."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, replace

from gsedit.formats.registry import READABLE
from gsedit.words.instruction import Change
from gsedit.words.lexicon import LIKE, pattern

SUFFIX = rf"(?:{'|'.join(map(re.escape, READABLE))})\b"
FILE = re.compile(rf"\"[^\"]+{SUFFIX}\"|'[^']+{SUFFIX}'|[^\s\"',;]+{SUFFIX}", re.IGNORECASE)
"""A scene's file in a sentence; one with spaces in its name is in quotes."""
NUMBERED = re.compile(r"\b(?:the )?object ?(\d+)\b", re.IGNORECASE)
"""An object by its number, as gsedit select --objects tells it."""
BEFORE = r"\b(the|this|that|these|those|my|our|your|its|their)\s+"
"""Words after which a saved name is one: "make it gold" is no call of what was saved as gold."""
WRITTEN = re.compile(r"[_-]|[a-z]\w*\d", re.IGNORECASE)
"""A sign that a name is written as it was saved, "left_leg-2": it needs no word before it."""
NOUNS = ("vase", "chair", "lamp", "clock", "barrel", "teapot", "boat", "piano", "ladder", "drum")
"""Nouns that the network knows, to stand for names."""
GIVEN = pattern("given")
"""Words for the style of a picture that is given beside the sentence."""
GIVEN_STYLE = "woodcut"
"""Style that the network knows, to stand for it."""
FILE_NOUN = "hat"
"""Noun that stands for a file, which is put in."""


@dataclass(frozen=True)
class Called:
    """A sentence in which nouns stand for saved names, numbers of objects, and files."""

    text: str
    names: dict[str, str]
    """Name by its noun, with the word before it: "my left leg 2", "object 3"."""
    files: tuple[str, ...]
    given: bool = False
    """Whether `GIVEN_STYLE` stands for a picture's."""

    def restored(self, change: Change) -> Change:
        """A change of what is named, in place of the nouns."""
        phrase = change.phrase if change.name == "insert" else self._restored(change.phrase)
        if self.given and change.name == GIVEN_STYLE:
            change = replace(change, name=LIKE)
        place = change.place and replace(change.place, of=self._restored(change.place.of))
        keep = tuple(map(self._restored, change.keep))
        return replace(change, phrase=phrase, place=place, keep=keep)

    def _restored(self, phrase: str) -> str:
        for noun, name in self.names.items():
            if re.search(rf"\b{noun}\b", phrase):
                return name
        return phrase


def called(sentence: str, saved: Collection[str]) -> Called:
    """A sentence without files, numbers of objects and the `saved` names of selections, which win
    over all words; keys of `saved` are as `gsedit.select.saved.key_of_name` spells them."""
    files = tuple(match[0].strip("\"'") for match in FILE.finditer(sentence))
    text, given = GIVEN.subn(f"like a {GIVEN_STYLE}", FILE.sub(f"a {FILE_NOUN}", sentence))
    names = dict[str, str]()
    free = iter([each for each in NOUNS if not re.search(rf"\b{each}", text, re.IGNORECASE)])

    def stand_in(name: str) -> str:
        known = next((noun for noun, told in names.items() if told == name), None)
        noun = known or next(free, "")
        if noun:
            names[noun] = name
        return noun and f"the {noun}"

    def put(match: re.Match[str]) -> str:
        if match[1] is None and not WRITTEN.search(match[2]):
            return match[0]
        name = re.sub(r"[\s_-]+", " ", match[2].lower())
        return stand_in(f"{(match[1] or 'the').lower()} {name}") or match[0]

    if saved:
        longest_first = sorted(saved, key=lambda name: (-len(name), name))
        any_name = "|".join(re.escape(name).replace(r"\ ", r"[\s_-]+") for name in longest_first)
        pattern = rf"(?:{BEFORE})?(?<![\w-])({any_name})(?![\w-]|\.\w)"
        text = re.sub(pattern, put, text, flags=re.IGNORECASE)
    text = NUMBERED.sub(lambda found: stand_in(f"object {found[1]}") or found[0], text)
    return Called(text, names, files, given > 0)
