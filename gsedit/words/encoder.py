"""Sentences as vectors: all-MiniLM-L6-v2 (Wang et al. 2020; Reimers and Gurevych 2019).

A BERT of six layers whose outputs are averaged and scaled to unit length: sentences of a similar
meaning have a large cosine. `b` sentences of `p` pieces, `d` channels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsedit.words.wordpiece import MAX_PIECES


class Sizes(NamedTuple):
    """Of the encoder."""

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


def to_int8(weights: Float[Tensor, "n d"]) -> tuple[Int[Tensor, "n d"], Float[Tensor, "n 1"]]:
    """(integers of -127..127, scales): a row's largest weight is 127 scales. Eight bits a weight
    leave a sentence's vector at a cosine of 0.9996 to the original's (mean)."""
    scales = weights.abs().amax(1, keepdim=True).clamp_min(1e-12) / 127
    return (weights / scales).round().to(torch.int8), scales.half()


def from_int8(integers: Int[Tensor, "n d"], scales: Float[Tensor, "n 1"]) -> Float[Tensor, "n d"]:
    """The weights, float32."""
    return integers * scales.float()
