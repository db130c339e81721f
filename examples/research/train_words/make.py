"""Make the head of the reader: which looks a sentence's vector asks for.

python -m research.train_words.make -o head.safetensors

The encoder is the one that comes with gsedit (see convert.py); it stays as it is.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.storage.atomic import atomic_path
from gsedit.words.reader import ENCODER, SCENE_LOOKS, SUBJECT_LOOKS, load_encoder
from gsedit.words.wordpiece import SentenceEncoder, Sizes, tokenise
from research.train_words.sentences import Example, examples

STEPS, RATE = 250, 0.05
BATCH = 64
SMOOTHING = 0.05
SCALE = 5.0
"""Scale of the unit vectors during training, so that one rate suits weights and biases."""
DECAY = 0.01
"""Weight of the sum of squared weights, a look's share: chosen on sentences of the development."""


def main(arguments: Sequence[str] | None = None) -> None:
    from safetensors.torch import save

    parser = argparse.ArgumentParser(prog="research.train_words.make", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="file to write")
    options = parser.parse_args(arguments)
    listed = examples()
    head = train(vectors([each.sentence for each in listed]), listed)
    with atomic_path(options.out, overwrite=True) as temporary:
        temporary.write_bytes(save(head))


@torch.no_grad()
def vectors(sentences: Sequence[str]) -> Float[Tensor, "n d"]:
    """Encode each sentence; those of as many pieces together, so that none is padded."""
    pieces, state = load_encoder(ENCODER)
    vocabulary = {piece: row for row, piece in enumerate(pieces)}
    encoder = SentenceEncoder(Sizes(len(pieces))).eval()
    encoder.load_state_dict(state)
    rows = [torch.tensor(tokenise(each, vocabulary)) for each in sentences]
    result = torch.empty(len(rows), encoder.positions.shape[1])
    for count in {len(each) for each in rows}:
        alike = [i for i, each in enumerate(rows) if len(each) == count]
        for part in (alike[k : k + BATCH] for k in range(0, len(alike), BATCH)):
            result[part] = encoder(torch.stack([rows[i] for i in part]))
    return result


def train(x: Float[Tensor, "n d"], listed: Sequence[Example]) -> dict[str, Tensor]:
    """Two multinomial logistic regressions, all sentences at once; the reader's head."""
    weights = torch.tensor([each.weight for each in listed])
    subjects = torch.tensor([each.subject for each in listed])
    scenes = torch.tensor([each.scene for each in listed])
    return {
        **regression("subject", x, subjects, weights, len(SUBJECT_LOOKS) + 1),
        **regression("scene", x, scenes, weights, len(SCENE_LOOKS) + 1),
    }


def regression(
    name: str,
    x: Float[Tensor, "n d"],
    answers: Int[Tensor, " n"],
    weights: Float[Tensor, " n"],
    count: int,
) -> dict[str, Tensor]:
    """A linear layer's state, for unit vectors."""
    matrix = torch.zeros(count, x.shape[1], requires_grad=True)
    bias = torch.zeros(count, requires_grad=True)
    optimiser = torch.optim.Adam([matrix, bias], RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        each = F.cross_entropy(
            F.linear(SCALE * x, matrix, bias),
            answers,
            reduction="none",
            label_smoothing=SMOOTHING,
        )
        loss = (weights * each).sum() / weights.sum() + DECAY * matrix.square().sum() / count
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return {
        f"{name}.weight": (SCALE * matrix.detach()).half(),
        f"{name}.bias": bias.detach().half(),
    }


if __name__ == "__main__":
    main()
