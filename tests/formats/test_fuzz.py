"""Damaged files of every format: a clear error or a valid scene, in little memory and time."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import pytest
from fuzz_inputs import INPUTS, Input, fuzz_input
from fuzz_subjects import SUBJECTS, Subject
from fuzzing import fuzz

TIMES, TIMES_OF_INPUTS = 50, 15  # make fuzz: 2,000


@pytest.fixture(autouse=True)
def _traced() -> Iterator[None]:
    tracemalloc.start()
    yield
    tracemalloc.stop()


@pytest.mark.parametrize(
    "subject", [s for s in SUBJECTS if s.share == 1], ids=lambda subject: subject.name
)
def test_damaged_files_end_in_a_clear_error_or_a_valid_scene(subject: Subject, tmp_path):
    outcome = fuzz(subject, TIMES, tmp_path)
    assert outcome.failures == []
    assert outcome.valid + outcome.refused == TIMES
    assert outcome.refused > TIMES // 10  # it does damage


@pytest.mark.parametrize("subject", INPUTS, ids=lambda subject: subject.name)
def test_damaged_inputs_end_in_a_clear_error_or_are_valid(subject: Input, tmp_path):
    outcome = fuzz_input(subject, TIMES_OF_INPUTS, tmp_path)
    assert outcome.failures == []
    assert outcome.valid + outcome.refused == TIMES_OF_INPUTS
    assert outcome.refused  # it does damage
