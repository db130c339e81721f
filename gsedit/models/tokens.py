"""Latents as sequences of tokens, and instructions as sequences of token numbers.

`v` views, `c y x` latents; a token holds 2 by 2 cells: `n` tokens of `4 c` numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pixel_shuffle, pixel_unshuffle

from gsedit.diffusion.predictions import Latents


def packed(latents: Latents) -> Float[Tensor, "v n d"]:
    """Tokens row by row; of a token the channels come first, then the rows and columns in it."""
    return pixel_unshuffle(latents, 2).flatten(2).transpose(1, 2)


def unpacked(tokens: Float[Tensor, "v n d"], rows: int, columns: int) -> Latents:
    """Latents of `rows` by `columns` tokens: the inverse of `packed`."""
    return pixel_shuffle(tokens.transpose(1, 2).unflatten(2, (rows, columns)), 2)


def network_times(t: float, views: int, dtype: torch.dtype) -> Float[Tensor, " v"]:
    """The time as transformers read it, a share of 1000, rounded as their pipelines round it."""
    return torch.full((views,), t, dtype=torch.float32).to(dtype) / 1000


class Words(NamedTuple):
    """An instruction as a text encoder reads it."""

    ids: Int[Tensor, "1 l"]
    mask: Int[Tensor, "1 l"]
    """0 for the tokens that only fill it up."""


def words(tokenizer: Any, text: str, length: int) -> Words:
    """Token numbers, cut off or filled up to the length."""
    inputs = tokenizer(
        text, padding="max_length", max_length=length, truncation=True, return_tensors="pt"
    )
    return Words(inputs.input_ids, inputs.attention_mask)


def tokens_over(tokenizer: Any, text: str, length: int) -> int:
    """How many tokens of the text would be cut off."""
    return max(0, len(tokenizer(text, truncation=False).input_ids) - length)
