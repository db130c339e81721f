"""The network of the reader: its pieces of words, its weights, and the sentences it learns from."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
import torch
from research.reading.labelled import labelled, read
from research.reading.train import targets
from research.reading.varied import Varied

from gsedit.words.marks import network
from gsedit.words.marks.marked import pieces, vocabulary

OLDER = Path(__file__).parents[1] / "data" / "sentences" / "older.jsonl"


@pytest.mark.parametrize("text", ["", "a", "Café ☕ für 20 %!", "x" * 10_000, "مرحبا", "\u202eabc"])
def test_pieces_are_those_of_words_in_their_places(text):
    cut = pieces(text)
    names = list(vocabulary())
    assert [names[cut.ids[0]], names[cut.ids[-1]]] == ["[CLS]", "[SEP]"]
    assert len(cut.first) == len(cut.last) == len(cut.words)
    for (start, end), first, last in zip(cut.words, cut.first, cut.last):
        spelled = "".join(names[each].removeprefix("##") for each in cut.ids[first : last + 1])
        assert spelled in ("[UNK]", text[start:end].lower().replace("é", "e").replace("ü", "u"))


def test_weights_in_eight_bits_are_within_half_a_step():
    state = {"matrix": torch.randn(5, 7), "bias": torch.randn(5)}
    back = network.whole(network.packed(state))
    step = state["matrix"].abs().amax(1, keepdim=True) / 127
    assert ((back["matrix"] - state["matrix"]).abs() <= 0.51 * step).all()
    assert torch.allclose(back["bias"], state["bias"], rtol=1e-3)


def test_an_edit_of_a_labelled_sentence_keeps_its_marks():
    row = {"text": "paint the vase red, keep the lid", "keep": ["the lid"], "refuse": "no",
           "changes": [{"do": "paint", "name": "red", "of": "the vase"}]}  # fmt: skip
    told = labelled(row)
    of = told.slots[0].spans["of"]
    after = told.edited(of, "a big old chair").edited((0, 0), "please ")
    assert after.text == "please paint a big old chair red, keep the lid"
    spans = after.slots[0].spans
    assert after.text[slice(*spans["of"])] == "a big old chair"
    assert after.text[slice(*spans["name"])] == "red"
    assert after.text[slice(*after.kept[0])] == "the lid"


def test_varied_sentences_are_marked_within_their_words():
    varied = Varied(read([OLDER]), Random(0))
    some = [varied.one() for _ in range(100)]
    for each in some:
        assert all(0 <= a < b <= len(each.text) for a, b in each.spans()), each
    ids, told = targets(some, ["gold", "night"])
    assert ids.shape[0] == 100
    assert (told["ends"] < ids.shape[1]).all()
    assert any(each.refused for each in some)
