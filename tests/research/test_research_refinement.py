"""Extreme edits end with finite numbers, or are refused with what is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest
from research.refinement.cases import CASES
from research.refinement.run import measure, table

CHEAP = ("far-off camera", "broken scene", "target of NaN", "target of another size",
         "black target", "rates x 1000", "one view", "1 Gaussian")  # fmt: skip


@pytest.mark.parametrize("case", [c for c in CASES if c.name in CHEAP], ids=lambda c: c.name)
def test_an_extreme_edit_is_finite_or_refused(case):
    row = measure(replace(case, gaussians=min(case.gaussians, 100)), steps=2)
    if case.refused is None:
        assert row.outcome == "finite", row.message
    else:
        assert row.outcome == "refused"
        assert case.refused in row.message
    assert case.name in table([row])
