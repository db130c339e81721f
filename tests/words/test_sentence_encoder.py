"""The encoder is BERT with mean pooling; its file holds eight bits a weight."""

from __future__ import annotations

import pytest
import torch
from closeness import NETWORK, assert_near

from gsedit.words.wordpiece import MAX_PIECES, SentenceEncoder, Sizes

SIZES = Sizes(vocabulary=50, width=32, layers=2, heads=4)
LAYERS = {
    "attention.output.dense": "self_attn.out_proj",
    "attention.output.LayerNorm": "norm1",
    "intermediate.dense": "linear1",
    "output.dense": "linear2",
    "output.LayerNorm": "norm2",
}


def renamed(state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """BERT's weights under the names of SentenceEncoder."""
    tables = {name: state[f"embeddings.{name}_embeddings.weight"]
              for name in ("word", "position", "token_type")}  # fmt: skip
    result = {
        "pieces.weight": tables["word"],
        "positions": tables["position"][:MAX_PIECES] + tables["token_type"][0],
        "norm.weight": state["embeddings.LayerNorm.weight"],
        "norm.bias": state["embeddings.LayerNorm.bias"],
    }
    for layer in range(SIZES.layers):
        old, new = f"encoder.layer.{layer}", f"layers.layers.{layer}"
        for kind in ("weight", "bias"):
            parts = [state[f"{old}.attention.self.{p}.{kind}"] for p in ("query", "key", "value")]
            result[f"{new}.self_attn.in_proj_{kind}"] = torch.cat(parts)
            for theirs, ours in LAYERS.items():
                result[f"{new}.{ours}.{kind}"] = state[f"{old}.{theirs}.{kind}"]
    return result


def test_it_is_the_mean_of_berts_outputs_at_unit_length():
    transformers = pytest.importorskip("transformers", reason="pip install 'gsedit[diffusers]'")
    torch.manual_seed(0)
    config = transformers.BertConfig(
        vocab_size=50, hidden_size=32, num_hidden_layers=2, num_attention_heads=4,
        intermediate_size=128, initializer_range=0.5,
    )  # fmt: skip
    bert = transformers.BertModel(config, add_pooling_layer=False).eval()
    encoder = SentenceEncoder(SIZES).eval()
    encoder.load_state_dict(renamed(bert.state_dict()))
    for count in (2, 7, MAX_PIECES):
        rows = torch.randint(50, (3, count))
        with torch.no_grad():
            mean = bert(rows).last_hidden_state.mean(1)
            expected = mean / mean.norm(dim=1, keepdim=True)
            assert_near(encoder(rows), expected, NETWORK)
