"""Understanding of sentences. The strangers' sentences were not used in training."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gsedit.errors import InputError
from gsedit.words import reader
from gsedit.words.looks import LOOKS
from gsedit.words.reader import understand
from gsedit.words.understanding import ScoredLook, Understanding

NEAREST, BOTH, REFUSED, WRONGLY_REFUSED = 51, 11, 14, 10
"""Counts out of 65, 15, 20 and 65: two below the measured (docs/measurements/instructions.md)."""
STRANGERS = json.loads(Path(__file__).with_name("strangers.json").read_text())


def nearest(sentence: str) -> str:
    """The likeliest look of all, whether the sentence is known or not."""
    subject, scene = reader.load_reader()(sentence)
    scores = [*zip(subject[:-1].tolist(), reader.SUBJECT_LOOKS)]
    scores += zip(scene[:-1].tolist(), reader.SCENE_LOOKS)
    return max(scores, key=lambda each: each[0])[1].name


def test_a_strangers_look_is_the_nearest():
    right = [nearest(sentence) == name for sentence, name in STRANGERS["one"]]
    assert len(right) == 65
    assert sum(right) >= NEAREST


def test_both_looks_of_a_sentence_are_found():
    right = [set(understand(sentence).names) == set(names) for sentence, names in STRANGERS["two"]]
    assert len(right) == 15
    assert sum(right) >= BOTH


def test_what_no_look_fulfils_is_unknown():
    unknown = [not understand(sentence).known for sentence in STRANGERS["none"]]
    assert len(unknown) == 20
    assert sum(unknown) >= REFUSED
    refused = [sentence for sentence, _ in STRANGERS["one"] if not understand(sentence).known]
    assert len(refused) <= WRONGLY_REFUSED


@pytest.mark.parametrize("name", LOOKS)
def test_a_look_is_understood_by_its_name_and_by_its_wording(name):
    for sentence in (LOOKS[name].wording, f"make it {name}"):
        understood = understand(sentence)
        assert (understood.names, understood.known) == ((name,), True)


def sure_of(*names: str) -> Understanding:
    return Understanding(tuple(ScoredLook(name, 1.0) for name in names), known=True)


def test_the_scope_is_the_scenes_where_a_scenes_look_is_asked_for():
    assert sure_of("gold").scope == "subject"
    assert sure_of("snow").scope == "scene"
    assert sure_of("gold", "snow").scope == "scene"
    assert sure_of("gold", "snow").wordings == (
        "turn it into a golden statue", "make it snow",
    )  # fmt: skip


@pytest.mark.parametrize("sentence", ["", "?!", "日本語", "x" * 5000, "word " * 1000, "🎉"])
def test_any_text_is_read(sentence):
    understood = understand(sentence)
    assert 1 <= len(understood.looks) <= 2
    assert all(0 <= each.score <= 1 for each in understood.looks)


def test_a_damaged_file_says_what_to_do(tmp_path):
    (tmp_path / "head.safetensors").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"head.safetensors does not hold .* install it again"):
        reader.load_reader(tmp_path / "head.safetensors")
