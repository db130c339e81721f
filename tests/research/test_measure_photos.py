"""The measure of memory reads what it wrote, with and without a lens, and says its peak."""

from __future__ import annotations

import pytest
from research.measure_photos import measure, write_photos


@pytest.mark.parametrize("lens", [False, True])
def test_photos_are_written_read_and_fitted(lens, tmp_path, capsys):
    write_photos(tmp_path / "photos", 9, 32, 18, lens)
    measure(tmp_path / "photos", 1)
    said = capsys.readouterr().out
    assert said.startswith("9 photos")
    assert "1 steps" in said
    assert said.endswith(" GB\n")
