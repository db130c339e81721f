"""WordPiece: a sentence as rows of a vocabulary (Wu et al. 2016; as in BERT, uncased)."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

UNKNOWN, BEGIN, END = "[UNK]", "[CLS]", "[SEP]"
INSIDE = "##"
"""Begins every piece that does not begin a word."""
LONGEST_WORD = 100  # letters; BERT's own limit: longer ones are unknown
MAX_PIECES = 96
"""Of a sentence, with both ends; the others are not read."""


def words_of(sentence: str) -> list[str]:
    """Its words and punctuation marks, lower case and without accents."""
    parts = unicodedata.normalize("NFD", sentence.lower())
    plain = "".join(c for c in parts if unicodedata.category(c) != "Mn")
    return re.findall(r"[^\W_]+|[^\w\s]|_", plain)


def pieces_of(word: str, vocabulary: Mapping[str, int]) -> list[int]:
    """The longest piece that begins the word, then that which begins the rest, and so on; a word
    that cannot be put together is unknown."""
    rows: list[int] = []
    start = 0
    while start < len(word) <= LONGEST_WORD:
        prefix = INSIDE if start else ""
        ends = range(len(word), start, -1)
        end = next((end for end in ends if prefix + word[start:end] in vocabulary), None)
        if end is None:
            break
        rows.append(vocabulary[prefix + word[start:end]])
        start = end
    return rows if start == len(word) else [vocabulary[UNKNOWN]]


def tokenise(sentence: str, vocabulary: Mapping[str, int]) -> list[int]:
    """Rows of the vocabulary for a sentence's pieces, between those of both ends."""
    rows = [row for word in words_of(sentence) for row in pieces_of(word, vocabulary)]
    return [vocabulary[BEGIN], *rows[: MAX_PIECES - 2], vocabulary[END]]
