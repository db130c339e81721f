"""Network that marks in a sentence what is asked for: each change, its words, and what stays.

An encoder of pieces of words (the shape of MiniLM-L6: Wang et al. 2020) and a decoder with one
query for each change in order. The weights are trained by examples/research/reading/train.py.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Bool, Float, Int
from safetensors import safe_open
from torch import Tensor, nn
from torch.nn.functional import gelu, scaled_dot_product_attention

from gsedit.words.marks.marked import (
    CHANGES,
    DEEDS,
    DEGREES,
    KEPT,
    PARTS,
    SIDES,
    SIGNS,
    SPANS,
    TONES,
    WAYS,
)  # fmt: skip

WEIGHTS = Path(__file__).with_name("reader.safetensors")
"""Weights in 8 bits with a scale for each row."""
WIDTH, INNER, HEADS, LAYERS, PIECES, PLACES = 384, 1536, 12, 6, 30522, 512


class Layer(nn.Module):
    """One layer of the encoder: attention and two linear maps, each added and normalised."""

    def __init__(self) -> None:
        super().__init__()
        self.query, self.key, self.value, self.out = (nn.Linear(WIDTH, WIDTH) for _ in range(4))
        self.up, self.down = nn.Linear(WIDTH, INNER), nn.Linear(INNER, WIDTH)
        self.norm, self.last_norm = (nn.LayerNorm(WIDTH, eps=1e-12) for _ in range(2))
        self.drop = nn.Dropout(0.1)

    def forward(
        self, x: Float[Tensor, "n t c"], seen: Bool[Tensor, "n 1 1 t"]
    ) -> Float[Tensor, "n t c"]:
        """States after the layer, of the pieces that are `seen`."""
        split = [
            each(x).unflatten(-1, (HEADS, -1)).transpose(1, 2)
            for each in (self.query, self.key, self.value)
        ]
        mixed = scaled_dot_product_attention(*split, attn_mask=seen).transpose(1, 2).flatten(2)
        x = self.norm(x + self.drop(self.out(mixed)))
        return self.last_norm(x + self.drop(self.down(gelu(self.up(x)))))


class Encoder(nn.Module):
    """States of the pieces of sentences."""

    def __init__(self) -> None:
        super().__init__()
        self.pieces, self.places = nn.Embedding(PIECES, WIDTH), nn.Embedding(PLACES, WIDTH)
        self.norm = nn.LayerNorm(WIDTH, eps=1e-12)
        self.layers = nn.ModuleList(Layer() for _ in range(LAYERS))

    def forward(self, ids: Int[Tensor, "n t"], seen: Bool[Tensor, "n t"]) -> Float[Tensor, "n t c"]:
        """States of pieces by their numbers; those not `seen` are padding."""
        x = self.norm(self.pieces(ids) + self.places.weight[: ids.shape[1]])
        for layer in self.layers:
            x = layer(x, seen[:, None, None])
        return x


class Marker(nn.Module):
    """Scores of all that is marked in sentences."""

    def __init__(self, values: int) -> None:
        """`values`: number of names of materials, lights and looks that may be meant."""
        super().__init__()
        self.encoder = Encoder()
        self.changes = nn.Parameter(torch.randn(CHANGES, WIDTH) * 0.02)
        layer = nn.TransformerDecoderLayer(
            WIDTH, HEADS // 2, WIDTH * 2, dropout=0.1, batch_first=True, norm_first=True
        )
        self.decoder = nn.TransformerDecoder(layer, 2, nn.LayerNorm(WIDTH))
        sizes = {
            "deed": len(DEEDS) + 1, "tone": len(TONES), "part": len(PARTS), "sign": len(SIGNS),
            "degree": len(DEGREES), "side": len(SIDES), "way": len(WAYS), "value": values,
        }  # fmt: skip
        self.classes = nn.ModuleDict({name: nn.Linear(WIDTH, n) for name, n in sizes.items()})
        self.ends = nn.Linear(WIDTH, 2 * len(SPANS) * WIDTH)
        self.keys = nn.Linear(WIDTH, WIDTH)
        self.kept, self.refused = nn.Linear(WIDTH, len(KEPT)), nn.Linear(WIDTH, 2)
        self.drop = nn.Dropout(0.1)

    def forward(self, ids: Int[Tensor, "n t"], seen: Bool[Tensor, "n t"]) -> dict[str, Tensor]:
        """Scores by name: of the classes [n, change, class]; "ends" [n, change, first and last of
        each of SPANS, piece], the piece 0 for none; "kept" [n, piece, class]; "refused" [n, 2]."""
        states = self.drop(self.encoder(ids, seen))
        hidden = None if bool(seen.all()) else ~seen  # with a mask torch loads its compiler
        changes = self.changes.expand(len(ids), -1, -1)
        asked = self.decoder(changes, states, memory_key_padding_mask=hidden)
        ends = self.ends(asked).unflatten(-1, (2 * len(SPANS), WIDTH))
        scores = torch.einsum("nkec,ntc->nket", ends, self.keys(states)) / math.sqrt(WIDTH)
        return {
            **{name: each(asked) for name, each in self.classes.items()},
            "ends": scores.masked_fill(~seen[:, None, None], -1e4),
            "kept": self.kept(states),
            "refused": self.refused(states[:, 0]),
        }


@lru_cache(1)
def trained() -> tuple[Marker, tuple[str, ...]]:
    """(network, names of the values) with the weights of `WEIGHTS`."""
    with safe_open(WEIGHTS, "pt") as file:
        values = tuple(file.metadata()["values"].split("|"))
        stored = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    with torch.random.fork_rng():  # random numbers on "meta" would load torch's compiler, seconds
        network = Marker(len(values))
    network.load_state_dict(whole(stored), assign=True)
    return network.eval().requires_grad_(False), values


def packed(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights as they are stored: matrices in 8 bits with a scale for each row, the rest in 16."""
    found = dict[str, Tensor]()
    for name, value in state.items():
        if value.ndim < 2:
            found[name] = value.half()
            continue
        scale = value.abs().amax(1, keepdim=True).clamp_min(1e-8) / 127
        found[name] = (value / scale).round().to(torch.int8)
        found[f"{name}:scale"] = scale.float()
    return found


def whole(stored: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights of `packed` in 32 bits."""
    return {
        name: value.float() * stored[f"{name}:scale"]
        if f"{name}:scale" in stored
        else value.float()
        for name, value in stored.items()
        if not name.endswith(":scale")
    }
