"""The encoder is BERT with mean pooling, and eight bits a weight are enough."""

from __future__ import annotations

import pytest
import torch
from closeness import NETWORK, assert_near
from research.train_words.convert import renamed, to_int8

from gsedit.words.wordpiece import MAX_PIECES, SentenceEncoder, Sizes, from_int8

SIZES = Sizes(vocabulary=50, width=32, layers=2, heads=4)


def test_it_is_the_mean_of_berts_outputs_at_unit_length():
    transformers = pytest.importorskip("transformers", reason="pip install 'gsedit[diffusers]'")
    torch.manual_seed(0)
    config = transformers.BertConfig(
        vocab_size=50, hidden_size=32, num_hidden_layers=2, num_attention_heads=4,
        intermediate_size=128, initializer_range=0.5,
    )  # fmt: skip
    bert = transformers.BertModel(config, add_pooling_layer=False).eval()
    encoder = SentenceEncoder(SIZES).eval()
    encoder.load_state_dict(renamed(bert.state_dict(), list(range(50))))
    for count in (2, 7, MAX_PIECES):
        rows = torch.randint(50, (3, count))
        with torch.no_grad():
            mean = bert(rows).last_hidden_state.mean(1)
            expected = mean / mean.norm(dim=1, keepdim=True)
            assert_near(encoder(rows), expected, NETWORK)


def test_eight_bits_are_half_a_scale_from_the_weights():
    weights = torch.randn(20, 30, generator=torch.Generator().manual_seed(0))
    weights[3] = 0
    integers, scales = to_int8(weights)
    assert integers.dtype == torch.int8
    error = (from_int8(integers, scales) - weights).abs()
    assert (error <= 0.56 * scales).all()  # half, and the scale's own rounding to half precision
