"""WordPiece: a sentence as rows of a vocabulary (Wu et al. 2016; as in BERT, uncased)."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

UNKNOWN, BEGIN, END = "[UNK]", "[CLS]", "[SEP]"
INSIDE = "##"
"""Begins every piece that does not begin a word."""
LONGEST_WORD = 100  # letters; BERT's own limit: longer ones are unknown
MAX_PIECES = 96
"""Most pieces of a sentence that are read, both ends included."""


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


class Sizes(NamedTuple):
    """Sizes of the sentence encoder."""

    vocabulary: int
    width: int = 384
    layers: int = 6
    heads: int = 12


class SentenceEncoder(nn.Module):
    """BERT with post-norm layers and mean pooling; its one token type is part of the positions."""

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        d = sizes.width
        self.pieces = nn.Embedding(sizes.vocabulary, d)
        self.positions = nn.Parameter(torch.zeros(MAX_PIECES, d))
        self.norm = nn.LayerNorm(d, eps=1e-12)
        layer = nn.TransformerEncoderLayer(
            d, sizes.heads, 4 * d, 0.0, "gelu", layer_norm_eps=1e-12, batch_first=True
        )
        self.layers = nn.TransformerEncoder(layer, sizes.layers, enable_nested_tensor=False)

    def forward(self, rows: Int[Tensor, "b p"]) -> Float[Tensor, "b d"]:
        """Unit vectors of sentences with as many pieces each, at most MAX_PIECES."""
        x = self.norm(self.pieces(rows) + self.positions[: rows.shape[1]])
        return F.normalize(self.layers(x).mean(1), dim=1)


def from_int8(integers: Int[Tensor, "n d"], scales: Float[Tensor, "n 1"]) -> Float[Tensor, "n d"]:
    """Weights as float32, from integers and scales."""
    return integers * scales.float()
