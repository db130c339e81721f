"""Damaged inputs of every kind: a clear error or a valid result, in little memory and time."""

from __future__ import annotations

import tracemalloc

import pytest
from fuzz_inputs import INPUTS, Input, fuzz

TIMES = {True: 50, False: 15}  # of scenes, and of others; make fuzz: 2,000


@pytest.mark.parametrize(
    "subject", [each for each in INPUTS if each.share == 1], ids=lambda subject: subject.name
)
def test_damaged_files_end_in_a_clear_error_or_a_valid_scene(subject: Input, tmp_path):
    tracemalloc.start()
    try:
        outcome = fuzz(subject, times := TIMES[subject.is_scene], tmp_path)
    finally:
        tracemalloc.stop()
    assert outcome.failures == []
    assert outcome.valid + outcome.refused == times
    assert outcome.refused > times // 10 * subject.is_scene  # it does damage
