"""Objects by their numbers, as `gsedit select --objects` tells them."""

import pytest
from labelled import statue

from gsedit.select.finder import Finder
from gsedit.words.phrases import BASED
from gsedit.words.read import read_instruction


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
