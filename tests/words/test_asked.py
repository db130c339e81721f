"""Looks of `small` that sentences ask for: the ones that were read, or none."""

from __future__ import annotations

import pytest

from gsedit.words.asked import looks_asked
from gsedit.words.looks import LOOKS
from gsedit.words.small_looks import change_of_look, look_of


@pytest.mark.parametrize("name", LOOKS)
def test_a_look_is_asked_for_by_its_wording_and_is_its_change(name):
    assert looks_asked(LOOKS[name].wording).names == (name,)
    assert look_of(change_of_look(LOOKS[name])) == LOOKS[name]


@pytest.mark.parametrize(
    "sentence", ["remove the snow", "do not paint it red", "paint the ears red"]
)
def test_a_refused_sentence_has_no_look_to_guess(sentence):
    asked = looks_asked(sentence)
    assert (asked.known, asked.looks) == (False, ())
    assert asked.why


def test_a_guess_is_for_what_is_not_known():
    assert looks_asked("blorf the quandle").looks
    assert not looks_asked("blorf the quandle").known


@pytest.mark.parametrize(
    ("sentence", "names"),
    [
        ("darken it", ("darker",)), ("warm it up", ("warmer",)),
        ("a golden statue in the snow", ("gold", "snow")), ("marble, not gold", ("marble",)),
    ],
)  # fmt: skip
def test_looks_are_those_of_the_changes(sentence, names):
    assert looks_asked(sentence).names == names


@pytest.mark.parametrize(
    "sentence", ["less contrast", "make the background darker", "everything in gold"]
)
def test_what_no_look_does_is_not_known_with_the_next_move(sentence):
    asked = looks_asked(sentence)
    assert (asked.known, asked.looks) == (False, ())
    assert "--editor pix2pix" in asked.why or "--region" in asked.why
