"""`gsedit list looks`: the looks, and the changes that a sentence asks for."""

from __future__ import annotations

import json

from command_line import gsedit

from gsedit.words.looks import LOOKS


def test_every_look_is_listed():
    result = gsedit("list", "looks", "--json")
    listed = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["name"] for each in listed] == list(LOOKS)


def test_a_sentence_is_read():
    result = gsedit("looks", "paint the bear teal and lower the contrast by 20%", "--json")
    record = json.loads(result.stdout)
    assert record["known"] is True
    assert record["changes"] == [
        {
            "target": "subject", "kind": "paint", "name": "teal", "color": "#029386",
            "amount": None, "route": "paint", "phrase": "", "place": None,
        },
        {
            "target": "scene", "kind": "tone", "name": "contrast", "color": None,
            "amount": -0.2, "route": "tone", "phrase": "", "place": None,
        },
    ]  # fmt: skip


def test_a_sentence_that_nothing_fulfills_is_refused_with_the_reason():
    record = json.loads(gsedit("looks", "give it a hat", "--json").stdout)
    assert (record["known"], record["changes"]) == (False, [])
    assert record["why"]
