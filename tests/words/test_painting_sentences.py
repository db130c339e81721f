"""Sixty sentences about painting styles, written before the rules that read them."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from gsedit.words.direct import LIKE
from gsedit.words.instruction import Change
from gsedit.words.lexicon import style_words
from gsedit.words.read import read_instruction

SENTENCES = json.loads(Path(__file__).with_name("painting_sentences.json").read_text("utf-8"))
NO_STYLE = "no style"


def answers(change: Change, asked: dict[str, Any]) -> bool:
    """Whether a change is one that was asked for."""
    if change.target != asked["target"] or change.phrase != asked.get("phrase", change.phrase):
        return False
    if "style" in asked:
        styles = {style_words().get(each) for each in asked["style"]}
        return change.route == "style" and change.name in styles
    return change.route != "style" and (change.kind, change.name) == (asked["kind"], asked["name"])


def drawable(asked: dict[str, Any]) -> bool:
    """Whether the painter has the style, if one is asked for."""
    return any(each in style_words() for each in asked.get("style", style_words()))


def grade(entry: dict[str, Any]) -> str:
    """One of right, wrong and opposite: what was to be kept is painted."""
    read = read_instruction(entry["text"])
    styled = [change for change in read.changes if change.route == "style"]
    if entry["kept"] and any(each.target in (entry["kept"], "scene") for each in styled):
        return "opposite"
    refused = not read.known or all(change.route == "pix2pix" for change in read.changes)
    if entry["changes"] == NO_STYLE:
        return "wrong" if styled else "right"
    if not entry["changes"]:
        return "right" if refused or {each.name for each in styled} == {LIKE} else "wrong"
    for asked in (entry["changes"], *entry["alternatives"]):
        if not all(map(drawable, asked)):
            continue
        pairs = zip(read.changes, asked)
        if len(read.changes) == len(asked) and all(answers(*pair) for pair in pairs):
            return "right"
    none = not any(all(map(drawable, each)) for each in (entry["changes"], *entry["alternatives"]))
    return "right" if none and refused else "wrong"


@pytest.mark.parametrize(("held_out", "least"), [(False, 26), (True, 26)])
def test_sentences_about_paintings_are_read_and_nothing_kept_is_painted(held_out, least):
    grades = Counter(grade(each) for each in SENTENCES if each["held_out"] is held_out)
    assert grades.total() == 30
    assert not grades["opposite"]
    assert grades["right"] >= least, grades


@pytest.mark.parametrize(
    "sentence",
    [
        "make the poster darker", "paint the mosaic red", "the comic on the table should be red",
        "paint the tiffany lamp red", "make the abstract sculpture red", "remove the poster",
        "put a poster on the wall", "add a mosaic to the floor", "paint it red and black",
        "paint the bear charcoal", "the bear made of stained glass", "vincent wants it red",
    ],
)  # fmt: skip
def test_a_thing_that_is_called_as_a_style_is_no_style(sentence):
    assert all(change.route != "style" for change in read_instruction(sentence).changes)


@pytest.mark.parametrize(
    ("sentence", "target", "style"),
    [
        ("in the woodcut style", "scene", "woodcut"),
        ("the bear in the comic look", "subject", "comic"), ("add a comic look", "scene", "comic"),
        ("render only the bear as a comic", "subject", "comic"),
        ("a mosaic out of the vase only", "subject", "stained glass"),
        ("make a woodcut of the vase only", "subject", "woodcut"),
        ("make a woodcut of the vase", "scene", "woodcut"),
        ("paint everything around the vase in the style of Picasso", "background", "cubist"),
        ("a painting by Monet", "scene", "impressionist"),
        ("the background like the attached painting", "background", LIKE),
    ],
)  # fmt: skip
def test_a_style_is_of_the_part_that_is_named(sentence, target, style):
    read = read_instruction(sentence)
    assert [(each.route, each.target, each.name) for each in read.changes] == [
        ("style", target, style)
    ]


def test_the_sky_alone_is_a_phrase():
    assert read_instruction("just the sky as a woodcut").changes[0].phrase == "the sky"
