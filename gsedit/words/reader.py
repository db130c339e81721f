"""Reader of a sentence: a subject's look, a scene's look, both, or nothing that is known."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.errors import InputError
from gsedit.words.looks import LOOKS, Look
from gsedit.words.understanding import ScoredLook, Understanding
from gsedit.words.wordpiece import SentenceEncoder, Sizes, from_int8, tokenise

ENCODER = Path(__file__).with_name("encoder.safetensors")
HEAD = Path(__file__).with_name("head.safetensors")
SECOND = 0.7
"""Least probability, against none, of the second of two looks: most sentences ask for one. Chosen
on sentences of the development, as is the decay of the head's weights."""
SUBJECT_LOOKS = tuple(look for look in LOOKS.values() if look.scope == "subject")
SCENE_LOOKS = tuple(look for look in LOOKS.values() if look.scope == "scene")


class Reader(nn.Module):
    """A sentence encoder and a linear head: two distributions, over the subject's looks and over
    the scene's looks, each with "none" as its last answer."""

    def __init__(self, vocabulary: Mapping[str, int], sizes: Sizes) -> None:
        super().__init__()
        self.vocabulary = vocabulary
        self.encoder = SentenceEncoder(sizes)
        self.subject = nn.Linear(sizes.width, len(SUBJECT_LOOKS) + 1)
        self.scene = nn.Linear(sizes.width, len(SCENE_LOOKS) + 1)

    @torch.no_grad()
    def forward(self, sentence: str) -> tuple[Float[Tensor, " s"], Float[Tensor, " c"]]:
        """Probabilities of the subject's looks and none, of the scene's looks and none."""
        vector = self.encoder(torch.tensor([tokenise(sentence, self.vocabulary)]))[0]
        return self.subject(vector).softmax(0), self.scene(vector).softmax(0)

    def read(self, sentence: str) -> Understanding:
        """The look that is likeliest against none, and the other scope's too if it is sure."""
        likeliest, sure = zip(*map(_likeliest, (SUBJECT_LOOKS, SCENE_LOOKS), self(sentence)))
        known = max(sure) > 0.5
        if known and min(sure) > SECOND:
            return Understanding(likeliest, known)
        return Understanding((likeliest[sure.index(max(sure))],), known)


def _likeliest(
    looks: tuple[Look, ...], probabilities: Float[Tensor, " n"]
) -> tuple[ScoredLook, float]:
    """The likeliest look, and how likely it is if the answer is either this look or none."""
    best = int(probabilities[:-1].argmax())
    score, none = float(probabilities[best]), float(probabilities[-1])
    return ScoredLook(looks[best].name, score), score / (score + none)


def understand(sentence: str) -> Understanding:
    """Read a sentence with the reader that comes with gsedit.

    Raises InputError where one of its files is missing or damaged.
    """
    return load_reader().read(sentence)


@lru_cache(maxsize=1)
def load_reader(head_file: Path = HEAD) -> Reader:
    """The reader that comes with gsedit, kept in memory: 90 MB. Raises as `understand`."""
    path = ENCODER
    try:
        pieces, encoder = load_encoder(path)
        path = head_file
        head = _tensors(path)[1]
        rows = {piece: row for row, piece in enumerate(pieces)}
        with torch.device("meta"):  # no random weights are drawn only to be replaced
            reader = Reader(rows, Sizes(len(rows)))
        state = {f"encoder.{name}": tensor for name, tensor in encoder.items()}
        reader.load_state_dict(state | head, assign=True)
    except Exception as error:  # safetensors, json and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights that read an instruction ({reason}): "
            "they come with gsedit: install it again, or check the file out again in a clone"
        ) from error
    return reader.eval().requires_grad_(False)


def load_encoder(path: Path) -> tuple[list[str], dict[str, Tensor]]:
    """(vocabulary, state of SentenceEncoder). Matrices are stored as integers of eight bits with a
    scale a row (see from_int8)."""
    metadata, stored = _tensors(path)
    state = {
        name: from_int8(tensor, stored[f"{name}.scale"]) if tensor.dtype == torch.int8 else tensor
        for name, tensor in stored.items()
        if not name.endswith(".scale")
    }
    return json.loads(metadata["vocabulary"]), state


def _tensors(path: Path) -> tuple[dict[str, str], dict[str, Tensor]]:
    """A file's metadata and tensors, those in half precision as float32."""
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        metadata = file.metadata() or {}
    return metadata, {
        name: tensor if tensor.dtype == torch.int8 else tensor.float()
        for name, tensor in tensors.items()
    }
