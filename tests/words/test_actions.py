"""Sentences about objects: what is done with which one, and what is never done."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from sentence_grades import read_all

from gsedit.formats.registry import READABLE
from gsedit.words.instruction import Change, Place
from gsedit.words.read import read_instruction

ASKED = json.loads(
    (Path(__file__).parents[1] / "data" / "sentences" / "actions.json").read_text(encoding="utf-8")
)
DONE = [
    each["text"].rstrip(".")
    for each in ASKED
    if each["known"] and all(change["kind"] == "object" for change in each["changes"])
]


def changes(sentence: str) -> tuple[Change, ...]:
    read = read_instruction(sentence)
    assert read.known, read.why
    return read.changes


@pytest.mark.parametrize(
    "frame",
    [
        "don't {}", "never {}", "I don't want you to {}", "avoid this: {}", "stop, do not {}",
        "{}? no", "{} - not!", "anything but {}", "there is no need to {}", "nobody asked to {}",
        "if you {}, paint it red", "he said: {}", "{}. No wait, leave it",
        "do not, whatever they say, {}", "paint it red, but do not {}", "who wants to {}?",
    ],
)  # fmt: skip
def test_a_negation_around_any_action_keeps_it_from_being_done(frame):
    assert len(DONE) > 20
    some = [frame.format(each) for each in DONE if not re.match("Please|insert", each)]
    for read in read_all(some):
        assert all(change.route != "object" for change in read.changes), read


@pytest.mark.parametrize(
    ("sentence", "made"),
    [
        ("make the red one smaller, darker and blue",
         [("the red one", "scale"), ("the red one", "brightness"), ("the red one", "blue")]),
        ("make the red ball blue and a bit smaller",
         [("the red ball", "blue"), ("the red ball", "scale")]),
        ("make it bigger and red", [("it", "scale"), ("", "red")]),
        ("spin it around so it faces the other way", [("it", "turn")]),
    ],
)  # fmt: skip
def test_what_goes_on_is_said_of_what_was_named(sentence, made):
    read = changes(sentence)
    assert [(each.phrase, each.name) for each in read] == made
    assert all(each.target == "subject" for each in read)


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("undo", "nothing is overwritten"), ("undo the last edit", "nothing is overwritten"),
        ("remove everything", "leaves no scene"), ("please delete all of it.", "leaves no scene"),
        ("make it 20 times as big", "0.1 to 10"), ("add a hat", "put hat.ply"),
    ],
)  # fmt: skip
def test_a_refusal_says_what_can_be_done_instead(sentence, told):
    read = read_instruction(sentence)
    assert not read.known
    assert told in read.why


@pytest.mark.parametrize(
    "sentence",
    [
        "remove moss from the base only",
        "undo the blue tint",
        "I don't want the bear standing there anymore",
    ],
)
def test_words_like_those_of_an_action_remove_nothing(sentence):
    assert all(each.name != "remove" for each in read_instruction(sentence).changes)


@pytest.mark.parametrize("suffix", READABLE)
def test_a_file_of_every_format_that_is_read_can_be_put_in(suffix):
    name = f"Things/Vase{suffix}" if suffix.startswith(".") else f"Things/Vase/{suffix}"
    (change,) = changes(f"put {name} on the table")
    assert (change.name, change.phrase, change.place) == ("insert", name, Place("on", "the table"))


def test_looks_and_actions_are_in_the_order_of_the_sentence():
    names = [each.name for each in changes("remove the bear and make it night")]
    assert names == ["remove", "night"]
    moved = changes("move the red one to the left and paint it gold")
    assert [each.phrase for each in moved] == ["the red one", "the red one"]
    assert [each.phrase for each in changes("copy the red one and paint it gold")][1] == "the copy"


def test_weather_materials_and_tones_keep_their_routes():
    for sentence, route in (
        ("make it snow", "scenery"), ("turn it into bronze", "material"),
        ("bring the colors out", "tone"), ("the brightness is bad, raise it", "tone"),
        ("make the contrast twice as big", "tone"), ("put a thick layer of snow on it", "object"),
        ("cover the ground with fallen leaves", "object"),
    ):  # fmt: skip
        assert [each.route for each in changes(sentence)] == [route], sentence
