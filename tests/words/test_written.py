"""Changes as JSON in place of a sentence: what is read is taken back, what is wrong is named."""

from __future__ import annotations

import json

import pytest

from gsedit.errors import UsageError
from gsedit.words.instruction import Change, Place
from gsedit.words.read import read_instruction

GOLD = {"target": "subject", "kind": "material", "name": "gold", "phrase": "the bear"}
CHANGES = (
    Change("subject", "material", "gold", None, None, "material", "the bear", None, ("its nose",)),
    Change("scene", "light", "sunset from the left", None, -0.4, "light"),
    Change("subject", "object", "move", None, 0.3, "object", "it", Place("left", metres=True)),
    Change("scene", "growth", "snow", None, None, "object"),
    Change("subject", "paint", "red", "#e50000", None, "paint", "the vase"),
)


@pytest.mark.parametrize("change", CHANGES)
def test_a_record_of_a_reading_is_that_reading(change):
    from dataclasses import asdict

    read = read_instruction(json.dumps({"changes": [asdict(change)]}))
    assert read.known
    assert read.changes == (change,)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('{"changes"', "no JSON"), ('{"changes": []}', "1 to 20"),
        ('{"changes": [3]}', "changes[0]"), ('{"changes":' + "[" * 50_000, "no JSON"),
        (json.dumps({"changes": [{**GOLD, "target": "sky"}]}), "changes[0].target"),
        (json.dumps({"changes": [{**GOLD, "kind": "tone"}]}), "changes[0].name"),
        (json.dumps({"changes": [{**GOLD, "color": "red"}]}), "changes[0].color"),
        (json.dumps({"changes": [{**GOLD, "amount": 1e9}]}), "changes[0].amount"),
        (json.dumps({"changes": [{**GOLD, "keep": "nose"}]}), "changes[0].keep"),
        (json.dumps({"changes": [{**GOLD, "place": {"side": "inside"}}]}), "changes[0].place"),
        (json.dumps({"changes": [GOLD, {**GOLD, "size": 1}]}), "changes[1]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(text, named):
    with pytest.raises(UsageError, match=named.replace("[", r"\[")):
        read_instruction(text)
