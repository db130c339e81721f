"""Every bad input ends in one line that names the file, the place and the next move."""

from __future__ import annotations

import pytest
from bad_files import BAD_FILES, BadFile

from gsedit import load_dataset
from gsedit.errors import GseditError
from gsedit.formats.scenes import load

MOVES = (
    "again", "check", "copy", "name ", "add ", "--drop-invalid", "repair", "remove", "use the",
    "correct", "calibrate", "image_undistorter",
)  # fmt: skip
"""Words of next moves."""


@pytest.mark.parametrize("bad", BAD_FILES, ids=lambda bad: bad.name)
def test_bad_input_is_one_line_with_place_and_next_move(bad: BadFile, tmp_path):
    path = bad.build(tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(GseditError) as raised:
        load(path) if bad.kind == "scene" else [view.image for view in load_dataset(path).views]
    message = str(raised.value)
    assert "\n" not in message
    assert str(path) in message
    assert all(word in message for word in bad.words)
    assert any(move in message for move in MOVES)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
