"""Words of a sentence with their places, and the pieces of words that the network reads."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

VOCABULARY = Path(__file__).with_name("vocabulary.txt")
"""Pieces of words, one a line, in the order of the network's embeddings."""
WORD = re.compile(r"[^\W\d_]+|\d+(?:[.,]\d+)?|\S")
"""A word, a number, or one other sign."""
LONGEST_WORD = 40
"""Letters of a word that is still cut into pieces."""
MOST_PIECES = 160
"""Pieces of a sentence that are read."""
FIRST, LAST, UNKNOWN = "[CLS]", "[SEP]", "[UNK]"


@dataclass(frozen=True)
class Pieces:
    """A sentence as the network reads it."""

    text: str
    words: tuple[tuple[int, int], ...]
    """First letter and end of each word in the text."""
    ids: tuple[int, ...]
    """Numbers of the pieces, with one before the first word and one after the last."""
    first: tuple[int, ...]
    """Index in `ids` of the first piece of each word."""
    last: tuple[int, ...]
    """Index in `ids` of the last piece of each word."""

    def said(self, start: int, end: int) -> str:
        """The text from a word to a word, both counted."""
        return self.text[self.words[start][0] : self.words[end][1]]


@lru_cache(1)
def vocabulary() -> dict[str, int]:
    """Numbers of the pieces."""
    return {piece: at for at, piece in enumerate(VOCABULARY.read_text("utf-8").splitlines())}


def plain(word: str) -> str:
    """A word in lower case without accents."""
    apart = unicodedata.normalize("NFD", word.replace("\u2019", "'").lower())
    return "".join(each for each in apart if unicodedata.category(each) != "Mn")


def pieces(text: str) -> Pieces:
    """The words of a text and their pieces; a text that is too long ends after `MOST_PIECES`."""
    numbers = vocabulary()
    ids, first, last, words = [numbers[FIRST]], list[int](), list[int](), list[tuple[int, int]]()
    for match in WORD.finditer(text):
        cut = _cut(plain(match[0]))
        if len(ids) + len(cut) >= MOST_PIECES:
            break
        first.append(len(ids))
        ids += cut
        last.append(len(ids) - 1)
        words.append((match.start(), match.end()))
    return Pieces(text, tuple(words), (*ids, numbers[LAST]), tuple(first), tuple(last))


@lru_cache(4096)
def _cut(word: str) -> tuple[int, ...]:
    """Numbers of the longest pieces of a word, from its start; the unknown one for none."""
    numbers, found, at = vocabulary(), list[int](), 0
    while at < len(word) <= LONGEST_WORD:
        ends = range(len(word), at, -1)
        whole = ("##" * bool(at) + word[at:end] for end in ends)
        end, piece = next(((e, p) for e, p in zip(ends, whole) if p in numbers), (at, ""))
        if not piece:
            return (numbers[UNKNOWN],)
        found.append(numbers[piece])
        at = end
    return tuple(found) or (numbers[UNKNOWN],)
