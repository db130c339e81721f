"""The text encoder of the small editor: laws that hold for any weights."""

from __future__ import annotations

import zlib

import pytest
import torch
from closeness import NETWORK, assert_near
from small_networks import random_network

from gsedit.editors.small.denoiser import Small
from gsedit.editors.small.text import BUCKETS, MAX_WORDS, subwords_of, tokenise, words_of


@pytest.fixture(scope="module")
def small() -> Small:
    return Small(random_network())


def test_words_are_read_without_case_and_punctuation():
    assert words_of('Turn it into a "Bronze" statue, please!') == [
        "turn", "it", "into", "a", "bronze", "statue", "please"
    ]  # fmt: skip


def test_a_bucket_is_the_same_in_every_process():
    assert subwords_of("it")[0] == 1 + zlib.crc32(b"<it>") % (BUCKETS - 1)
    assert len(set(subwords_of("bronze"))) > 8
    assert all(0 < bucket < BUCKETS for bucket in subwords_of("bronze"))


def test_similar_words_share_subwords():
    bronze, bronzed, blue = (set(subwords_of(word)) for word in ("bronze", "bronzed", "blue"))
    assert len(bronze & bronzed) > len(bronze) / 2
    assert len(bronze & blue) <= 1  # a collision may happen


@pytest.mark.parametrize("sentence", ["", "?!", "日本語", "x" * 1000, "word " * 1000, "ünïcödé 🎉"])
def test_any_text_has_tokens_and_a_finite_vector(small, sentence):
    tokens = tokenise([sentence])
    assert tokens.subwords.shape[1] == MAX_WORDS
    assert torch.isfinite(small.network.text_encoder(tokens)).all()


def test_a_sentence_does_not_depend_on_its_neighbors(small):
    sentences = ["make it snow", "as a bronze statue in the middle of the night", ""]
    together = small.network.text_encoder(tokenise(sentences))
    alone = torch.cat([small.network.text_encoder(tokenise([each])) for each in sentences])
    assert_near(together, alone, NETWORK)


def test_the_order_of_words_matters(small):
    first, second = small.network.text_encoder(tokenise(["red on blue", "blue on red"]))
    assert not torch.allclose(first, second, atol=1e-4)
