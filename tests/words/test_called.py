"""Saved selections called by name in sentences: the name wins over every list of words."""

import pytest

from gsedit.words.read import read_instruction

NAMES = ("plinth", "gray rock", "ears", "gold", "left leg 2", "arm3")


@pytest.mark.parametrize(
    ("sentence", "route", "phrase", "of"),
    [
        ("remove the plinth.", "object", "the plinth", None),
        ("make the Plinth twice as large", "object", "the plinth", None),
        ("move the bear next to the gray rock", "object", "the bear", "the gray rock"),
        ("paint the plinth red", "paint", "the plinth", None),
        ("make the ears gold", "material", "the ears", None),
        ("make it gold", "material", "", None),
        ("paint left_leg-2 gold", "paint", "the left leg 2", None),
        ("move my left_leg 2 next to Arm3", "object", "my left leg 2", "the arm3"),
    ],
)
def test_a_saved_name_is_a_thing(sentence, route, phrase, of):
    read = read_instruction(sentence, NAMES)
    assert read.known, read.why
    assert [(each.route, each.phrase) for each in read.changes] == [(route, phrase)]
    place = read.changes[0].place
    assert (place and place.of) == of
    assert read.text == sentence
    assert "zq" not in str(read)


def test_an_action_and_a_look_may_call_two_names():
    read = read_instruction("remove the plinth and paint the ears red", NAMES)
    assert [each.phrase for each in read.changes] == ["the plinth", "the ears"]


@pytest.mark.parametrize(
    "sentence",
    [
        "remove the head", "remove the plinth.ply", "do not remove the plinth", "make it gold",
    ],
)  # fmt: skip
def test_what_no_name_settles_is_read_as_ever(sentence):
    assert read_instruction(sentence, NAMES) == read_instruction(sentence, NAMES)
