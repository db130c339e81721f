"""Sentences as vectors: words and their subwords, hashed, so that no word is unknown.

`b` sentences of `w` words, `s` subwords a word, `d` channels. A word's vector is the mean over its
subwords: the whole word and every run of 3 to 5 letters, with marks at both ends of the word
(Bojanowski et al. 2017, fastText). A hash gives each subword its row (bucket) of one embedding
table, so there is no vocabulary: a word that training never showed still shares subwords with
words that it did show.
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

BUCKETS = 8192  # rows of the embedding table; 0 is padding
MAX_WORDS = 24  # of a sentence; the others are not read. Instructions have about ten
MAX_SUBWORDS = 24  # of a word: all of words up to 8 letters; of longer ones the first
NGRAM_LENGTHS = (3, 4, 5)


class Tokens(NamedTuple):
    """Sentences, ready for the encoder."""

    subwords: Int[Tensor, "b w s"]
    """Buckets; 0 where a word has no more subwords, or a sentence no more words."""

    @property
    def words(self) -> Bool[Tensor, "b w"]:
        """Flag the places that hold a word."""
        return self.subwords[..., 0] > 0


def words_of(sentence: str) -> list[str]:
    """Its words, lower case; the encoder reads the first MAX_WORDS."""
    return re.findall(r"[^\W_]+", sentence.lower())


@lru_cache(maxsize=1 << 14)
def subwords_of(word: str) -> tuple[int, ...]:
    """Buckets: the word's own, then those of its n-grams."""
    marked = f"<{word}>"
    ngrams = (marked[i : i + n] for n in NGRAM_LENGTHS for i in range(len(marked) - n + 1))
    subwords = (marked, *(ngram for ngram in ngrams if ngram != marked))
    return tuple(_bucket(subword) for subword in subwords[:MAX_SUBWORDS])


def tokenise(sentences: Sequence[str]) -> Tokens:
    """Any text; an empty sentence has no words."""
    tokens = torch.zeros(len(sentences), MAX_WORDS, MAX_SUBWORDS, dtype=torch.int64)
    for table, sentence in zip(tokens, sentences):
        for row, word in zip(table, words_of(sentence)[:MAX_WORDS]):
            subwords = subwords_of(word)
            row[: len(subwords)] = torch.tensor(subwords)
    return Tokens(tokens)


def _bucket(subword: str) -> int:
    """In [1, BUCKETS). The same on every machine and in every process, unlike Python's own hash."""
    return 1 + zlib.crc32(subword.encode()) % (BUCKETS - 1)


class TextEncoder(nn.Module):
    """A transformer over a sentence's words and one class token, whose output is the vector."""

    def __init__(self, width: int, layers: int, heads: int) -> None:
        super().__init__()
        self.subword_embedding = nn.EmbeddingBag(BUCKETS, width, mode="mean", padding_idx=0)
        self.position_embedding = nn.Parameter(0.02 * torch.randn(MAX_WORDS, width))
        self.layers = nn.ModuleList(TransformerLayer(width, heads) for _ in range(layers))
        self.class_token = nn.Parameter(0.02 * torch.randn(width))
        self.norm = nn.LayerNorm(width)

    def forward(self, tokens: Tokens) -> Float[Tensor, "b d"]:
        """One vector a sentence; that of a sentence without words is the null instruction's."""
        b, w, s = tokens.subwords.shape
        words = self.subword_embedding(tokens.subwords.reshape(b * w, s)).reshape(b, w, -1)
        words = words + self.position_embedding
        x = torch.cat((self.class_token.expand(b, 1, -1), words), 1)
        mask = F.pad(tokens.words, (1, 0), value=True)
        for layer in self.layers:
            x = layer(x, mask)
        return self.norm(x[:, 0])


class TransformerLayer(nn.Module):
    """Self-attention and a two-layer MLP, each behind a norm."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mlp = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(
        self, x: Float[Tensor, "b n d"], mask: Bool[Tensor, "b n"]
    ) -> Float[Tensor, "b n d"]:
        """`mask`: the tokens that may be attended to."""
        b, n, _ = x.shape
        q, k, v = self.qkv(self.norm1(x)).reshape(b, n, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        values = F.scaled_dot_product_attention(q, k, v, attn_mask=mask[:, None, None])
        x = x + self.out(values.transpose(1, 2).reshape(b, n, -1))
        return x + self.mlp(self.norm2(x))
