"""Sentences of many voices: nothing that stays changes, and the rate that was reached is held."""

from __future__ import annotations

from pathlib import Path

import pytest
from meanings import GOOD, entries, graded

VOICES = Path(__file__).parents[1] / "data" / "sentences" / "voices"


@pytest.mark.parametrize(
    ("name", "least"),
    [("w1", 0.50), ("w2", 0.43), ("w3", 0.46), ("w4", 0.40), ("w5", 0.40), ("w6", 0.37),
     ("w8", 0.47)],
)  # fmt: skip
def test_voices_are_understood_and_none_is_done_the_opposite_way(name, least):
    rows = graded(entries(VOICES / f"{name}.jsonl"))
    grades = [result for _, result, _, _ in rows]
    assert "OPPOSITE" not in grades
    assert sum(each in GOOD for each in grades) >= least * len(grades)
