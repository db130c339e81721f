"""Knobs: a turn is a sentence, and the sentence asks for what was turned."""

import pytest

from gsedit.app.reading import knobs_of, turned
from gsedit.words.read import read_instruction


def read(text):
    return read_instruction(text, ())


SENTENCES = [
    ("make the bear darker", ("amount",)),
    ("give it more contrast", ("amount",)),
    ("paint the red one blue", ("color", "finish")),
    ("turn the bear into bronze", ("finish",)),
    ("make the bear matte", ("finish",)),
    ("put a layer of moss on the largest", ("amount",)),
    ("make the red one twice as big", ("amount",)),
    ("turn it by 30 degrees", ("amount",)),
    ("paint it red and make the background darker", ("color", "finish", "amount")),
]


@pytest.mark.parametrize(("text", "kinds"), SENTENCES)
def test_a_turn_changes_its_value_and_nothing_else(text, kinds):
    instruction = read(text)
    knobs = knobs_of(instruction, read)
    assert tuple(knob.kind for knob in knobs) == kinds
    for knob in knobs:
        values = {
            "amount": [knob.low, 0.25 * knob.low, 0.37 * knob.high, knob.high],
            "color": ["#12ab9f"],
            "finish": knob.choices,
        }[knob.kind]
        for value in values:
            after = read(turned(instruction, knob, value))
            assert len(after.changes) == len(instruction.changes)
            again = knobs_of(after, read)
            assert [each.kind for each in again] == list(kinds)
            for old, new in zip(knobs, again, strict=True):
                wanted = value if old == knob else old.value
                assert new.value == (pytest.approx(wanted, abs=1e-4) if old.low else wanted)


@pytest.mark.parametrize("text", ["make it snow", "remove the bear", "oil painting"])
def test_what_has_no_amount_has_no_knob(text):
    assert knobs_of(read(text), read) == ()
