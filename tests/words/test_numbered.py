"""Objects by their numbers, as `gsedit select --objects` tells them."""

from __future__ import annotations

import pytest

from gsedit.words.read import read_instruction


@pytest.mark.parametrize(
    ("sentence", "target", "name"),
    [
        ("remove object 2", "subject", "remove"),
        ("remove the object 2", "subject", "remove"),
        ("scale object 2 by 2", "subject", "scale"),
        ("turn object 2 by 90 degrees", "subject", "turn"),
        ("Move object 2 to the left", "subject", "move"),
        ("turn object 2 into gold", "subject", "gold"),
        ("paint the object 2 red", "subject", "red"),
        ("everything but object 2 darker", "background", "brightness"),
    ],
)
def test_a_number_names_an_object_in_any_sentence(sentence, target, name):
    (change,) = read_instruction(sentence).changes
    assert (change.target, change.name, change.phrase) == (target, name, "object 2")


def test_a_numbered_object_is_never_taken_for_the_subject():
    assert not read_instruction("make object 2 twice as big").changes  # not read yet


def test_a_number_of_objects_is_none():
    assert not read_instruction("remove the 2 objects").changes
