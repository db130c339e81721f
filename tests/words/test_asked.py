"""Looks of `small` that sentences ask for: the ones that were read, or none."""

from __future__ import annotations

import pytest

from gsedit.errors import UsageError
from gsedit.words.asked import looks_asked
from gsedit.words.looks import LOOKS


@pytest.mark.parametrize("name", LOOKS)
def test_a_look_is_asked_for_by_its_wording(name):
    assert looks_asked(LOOKS[name].wording) == (LOOKS[name],)


@pytest.mark.parametrize(
    ("sentence", "names"),
    [
        ("darken it", ("darker",)), ("warm it up", ("warmer",)),
        ("a golden statue in the snow", ("gold", "snow")), ("marble, not gold", ("marble",)),
    ],
)  # fmt: skip
def test_looks_are_those_of_the_changes(sentence, names):
    assert tuple(look.name for look in looks_asked(sentence)) == names


@pytest.mark.parametrize(
    ("sentence", "move"),
    [
        ("remove the snow", "say"), ("do not paint it red", "say"),
        ("paint the ears red", "--region"), ("blorf the quandle", "bronze, gold"),
        ("less contrast", "bronze, gold"), ("make the background darker", "--region"),
        ("everything in gold", "--region"), ("give it a hat", "--editor pix2pix"),
    ],
)  # fmt: skip
def test_what_no_look_does_is_refused_with_the_next_move(sentence, move):
    with pytest.raises(UsageError, match=move):
        looks_asked(sentence)
