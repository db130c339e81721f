"""Sentences as vectors: words and their pieces, hashed, so that no word is unknown.

`b` sentences of `w` words, `d` channels. A word is the mean of the vectors of its pieces: the whole
of it and every run of 3 to 5 letters, its two ends marked (Bojanowski et al. 2017, fastText). Each
piece has its row in one table by a hash, so there is no vocabulary to keep: a word that was never
read still shares pieces with those that were, and one that shares none is a vector like any other.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

ROWS = 8192  # of the table; 0 is padding
WORDS = 24  # of a sentence that are read; instructions have about ten
PIECES = 24  # of a word: its own and those of 8 letters; of longer ones the first
LENGTHS = (3, 4, 5)


class Tokens(NamedTuple):
    """Sentences, ready for the encoder."""

    pieces: Int[Tensor, "b w p"]
    """Rows of the table; 0 where a word has no more pieces, or a sentence no more words."""

    @property
    def words(self) -> Bool[Tensor, "b w"]:
        """Where there is a word."""
        return self.pieces[..., 0] > 0


def words_of(sentence: str) -> list[str]:
    """Its words, lower case; of a sentence the first WORDS are read."""
    return re.findall(r"[^\W_]+", sentence.lower())


@lru_cache(maxsize=1 << 14)
def pieces_of(word: str) -> tuple[int, ...]:
    """Rows of the table: the word's own, then those of its runs of letters."""
    marked = f"<{word}>"
    runs = (marked[i : i + n] for n in LENGTHS for i in range(len(marked) - n + 1))
    pieces = (marked, *(run for run in runs if run != marked))
    return tuple(_row(piece) for piece in pieces[:PIECES])


def tokenise(sentences: Sequence[str]) -> Tokens:
    """Any text; an empty sentence has no words."""
    pieces = torch.zeros(len(sentences), WORDS, PIECES, dtype=torch.int64)
    for table, sentence in zip(pieces, sentences):
        for row, word in zip(table, words_of(sentence)[:WORDS]):
            found = pieces_of(word)
            row[: len(found)] = torch.tensor(found)
    return Tokens(pieces)


def _row(piece: str) -> int:
    """The same on every machine and in every process, as Python's own hash is not."""
    return 1 + zlib.crc32(piece.encode()) % (ROWS - 1)


class TextEncoder(nn.Module):
    """Sentences -> one vector each: words see each other, then one query reads them all."""

    def __init__(self, width: int, layers: int, heads: int) -> None:
        super().__init__()
        self.table = nn.EmbeddingBag(ROWS, width, mode="mean", padding_idx=0)
        self.places = nn.Parameter(0.02 * torch.randn(WORDS, width))
        self.blocks = nn.ModuleList(_Layer(width, heads) for _ in range(layers))
        self.first = nn.Parameter(0.02 * torch.randn(width))
        self.norm = nn.LayerNorm(width)

    def forward(self, tokens: Tokens) -> Float[Tensor, "b d"]:
        """The vector of a sentence without words depends on nothing: the null instruction."""
        b, w, p = tokens.pieces.shape
        words = self.table(tokens.pieces.reshape(b * w, p)).reshape(b, w, -1) + self.places
        x = torch.cat((self.first.expand(b, 1, -1), words), 1)
        seen = F.pad(tokens.words, (1, 0), value=True)
        for block in self.blocks:
            x = block(x, seen)
        return self.norm(x[:, 0])


class _Layer(nn.Module):
    """Self-attention and a two-layer perceptron, each behind a norm."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mlp = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(self, x: Float[Tensor, "b n d"], seen: Bool[Tensor, "b n"]) -> Tensor:
        b, n, _ = x.shape
        q, k, v = self.qkv(self.before(x)).reshape(b, n, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        read = F.scaled_dot_product_attention(q, k, v, attn_mask=seen[:, None, None])
        x = x + self.out(read.transpose(1, 2).reshape(b, n, -1))
        return x + self.mlp(self.between(x))
