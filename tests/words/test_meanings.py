"""Sentences of many voices: nothing that stays changes, and the rate that was reached is held."""

from __future__ import annotations

from pathlib import Path

import pytest
from meanings import GOOD, entries, graded

VOICES = Path(__file__).parents[1] / "data" / "sentences" / "voices"


@pytest.mark.parametrize(("name", "least"), [("w14", 0.79), ("../cases", 0.88)])
def test_voices_are_understood_and_hardly_any_is_done_the_opposite_way(name, least):
    rows = graded(entries(VOICES / f"{name}.jsonl")[:200])
    grades = [result for _, result, _, _ in rows]
    assert grades.count("OPPOSITE") <= 1  # of 200 that the network learned from
    assert sum(each in GOOD for each in grades) >= least * len(grades)
