"""Sentences of many voices: nothing that stays changes, and the rate that was reached is held."""

from __future__ import annotations

from pathlib import Path

import pytest
from meanings import GOOD, entries, graded

MOST_OPPOSITES = 1
"""Sentences of 400 that the network learned from: one of w1, w2 and w3 has a scope ("bg only")
that the grader does not know, and one of w6 is done the opposite way."""
VOICES = Path(__file__).parents[1] / "data" / "sentences" / "voices"


@pytest.mark.parametrize(
    ("name", "least"),
    [("w1", 0.75), ("w2", 0.75), ("w3", 0.73), ("w4", 0.72), ("w5", 0.72), ("w6", 0.75),
     ("w8", 0.77)],
)  # fmt: skip
def test_voices_are_understood_and_hardly_any_is_done_the_opposite_way(name, least):
    rows = graded(entries(VOICES / f"{name}.jsonl"))
    grades = [result for _, result, _, _ in rows]
    assert grades.count("OPPOSITE") <= MOST_OPPOSITES
    assert sum(each in GOOD for each in grades) >= least * len(grades)
