"""Looks are for the thing that a phrase tells apart; a noun alone is the main subject."""

from __future__ import annotations

import pytest

from gsedit.words.read import read_instruction


def told(sentence: str, saved: tuple[str, ...] = ()) -> list[tuple[str, str, str]]:
    read = read_instruction(sentence, saved)
    assert read.known, read.why
    return [(each.phrase, each.target, each.name) for each in read.changes]


LOOKS = ("paint {} blue", "turn {} into glass", "make {} darker", "make {} snowy",
         "light {} from the left")  # fmt: skip


@pytest.mark.parametrize(
    "phrase",
    ["the red one", "the ball on the left", "the small red bear",
     "the red thing"],
)  # fmt: skip
def test_a_look_is_for_what_a_phrase_tells_apart(phrase):
    for look in LOOKS:
        plain = read_instruction(look.format("the bear")).changes
        (change,) = read_instruction(look.format(phrase), accept_unread=True).changes
        assert (change.phrase, change.target) == (phrase, "subject")
        assert (change.name, change.amount) == (plain[0].name, plain[0].amount)


@pytest.mark.parametrize("noun", ["the bear", "the statue", "the wooden chair", "the dragon"])
def test_a_noun_alone_is_kept_as_a_phrase(noun):
    for look in LOOKS[:3]:
        assert all(each.phrase == noun for each in read_instruction(look.format(noun)).changes)


def test_each_thing_has_its_own_look():
    assert told("make the red one gold and darken the bear") == [
        ("the red one", "subject", "gold"), ("the bear", "subject", "brightness")
    ]  # fmt: skip
    both = told("paint the red one gold and the blue one green")
    assert [phrase for phrase, _, _ in both] == ["the red one", "the blue one"]
    assert told("make everything but the red one black and white")[0][1] == "background"


@pytest.mark.parametrize("frame", ["don't {}", "never {}"])
def test_what_is_denied_is_not_done(frame):
    for look in LOOKS:
        assert not read_instruction(frame.format(look.format("the red one"))).changes


@pytest.mark.parametrize(
    "sentence",
    [
        "remove the light from the left", "kill the light from the right", "dust off the bear",
        "icicles would be too much", "unless it is red, remove the bear", "wipe the slate clean",
        "remove all colors but red", "put the bear on the moon",
        "add a second sun", "insert <3>",
        "turn it purple by 30 degrees",
    ],
)  # fmt: skip
def test_a_turn_of_phrase_is_never_read_for_what_its_words_name(sentence):
    assert not read_instruction(sentence).changes


def test_what_goes_dark_becomes_dark():
    (dark,) = read_instruction("the bear should go dark").changes
    (bright,) = read_instruction("the statue should go bright").changes
    assert (dark.amount or 0) < 0 < (bright.amount or 0)
    assert told("the bear should go") == [("the bear", "subject", "remove")]


def test_a_look_beside_an_action_is_for_the_thing_that_it_names():
    assert told("remove the bear and make the table blue")[1][0] == "the table"
