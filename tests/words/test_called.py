"""Saved selections called by name in sentences: the name wins over every list of words."""

import pytest
from labelled import statue

from gsedit.select.finder import Finder
from gsedit.words.phrases import BASED
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


@pytest.mark.parametrize(
    "sentence",
    [
        "remove the head", "remove the plinth.ply", "do not remove the plinth", "make it gold",
    ],
)  # fmt: skip
def test_what_no_name_settles_is_read_as_ever(sentence):
    assert read_instruction(sentence, NAMES) == read_instruction(sentence)


@pytest.mark.parametrize(
    ("sentence", "target", "name"),
    [
        ("remove object 2", "subject", "remove"),
        ("remove the object 2", "subject", "remove"),
        ("scale object 2 by 2", "subject", "scale"),
        ("make object 2 twice as big", "subject", "scale"),
        ("make the object 2 a third smaller", "subject", "scale"),
        ("turn object 2 by 90 degrees", "subject", "turn"),
        ("Move object 2 to the left", "subject", "move"),
        ("turn object 2 into gold", "subject", "gold"),
        ("paint the object 2 red", "subject", "red"),
    ],
)
def test_a_number_names_an_object_in_any_sentence(sentence, target, name):
    (change,) = read_instruction(sentence).changes
    assert (change.target, change.name, change.phrase) == (target, name, "object 2")


@pytest.mark.parametrize(
    ("sentence", "name"),
    [
        ("turn the statue and its base into gold", "gold"),
        ("Remove the horse with its plinth", "remove"),
        ("make the dinosaur and its rock twice as big", "scale"),
        ("remove the clock, including the pedestal", "remove"),
    ],
)
def test_what_it_stands_on_is_added_where_a_sentence_says_so(sentence, name):
    (change,) = read_instruction(sentence).changes
    assert (change.name, change.phrase) == (name, BASED)
    assert Finder(statue(0, 10).gaussians).expression(change.phrase) == "subject(base=True)"


def test_a_plinth_alone_is_not_the_subject():
    assert all(each.phrase != BASED for each in read_instruction("remove the plinth").changes)
