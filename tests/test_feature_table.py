"""docs/toolkit.md: what it claims of gsedit has a test, and that test exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROWS = [
    [cell.strip() for cell in line.strip("| ").split(" | ")]
    for line in (ROOT / "docs/toolkit.md").read_text().splitlines()
    if line.startswith("| ") and not line.startswith("| feature")
]


def test_the_table_was_read():
    assert len(ROWS) > 30


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_every_claim_names_a_test_that_exists(row):
    claim, proof = (row[8], row[9]) if len(row) == 10 else (row[8], "")
    if claim.startswith("–") or proof.startswith("the suite"):
        return
    path, name = re.fullmatch(r"`(tests/[\w/]+\.py)::(test_\w+)`", proof).groups()
    assert re.search(rf"^def {name}\(", (ROOT / path).read_text(), re.MULTILINE)
