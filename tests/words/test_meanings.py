"""Sentences of many voices: nothing that stays changes, and the rate that was reached is held."""

from __future__ import annotations

from pathlib import Path

import pytest
from meanings import GOOD, compared, entries, graded

from gsedit.words.instruction import Change

VOICES = Path(__file__).parents[1] / "data" / "sentences" / "voices"


@pytest.mark.parametrize(("name", "least"), [("w14", 0.79), ("../cases", 0.88)])
def test_voices_are_understood_and_hardly_any_is_done_the_opposite_way(name, least):
    rows = graded(entries(VOICES / f"{name}.jsonl")[:270])
    grades = [result for _, result, _, _ in rows]
    assert grades.count("OPPOSITE") <= 1  # of 270 that the network learned from
    assert sum(each in GOOD for each in grades) >= least * len(grades)


def test_a_pronoun_is_the_thing_named_last():
    asked = [{"do": "scale", "of": "the pump"}, {"do": "remove", "of": "it"}]
    larger = Change("subject", "object", "scale", None, 0.5, "object", "the pump")
    for phrase, grade in (("the pump", "right"), ("the gate", "partly")):
        gone = Change("subject", "object", "remove", None, None, "object", phrase)
        assert compared([larger, gone], asked)[0] == grade
