"""mkkellogg's .ksplat, against files that are written here by its published layout."""

from __future__ import annotations

import numpy as np
import pytest
from ksplat_files import ksplat, near_grey
from splat_tables import assert_near

from gsedit.errors import InputError
from gsedit.formats.registry import open_scene
from rasterizer.numerics import SH_DC


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_all_levels_and_degrees(level, degree, tmp_path):
    table = near_grey(19, degree)
    source = open_scene(ksplat(tmp_path / "a.ksplat", level, table))
    assert (source.count, source.header.degree) == (19, degree)
    bounds = {"means": 1.3e-4, "angle": 3e-3, "log_scales": 1e-3} if level else {
        "means": 0.0, "angle": 1e-6, "log_scales": 1e-6}  # fmt: skip
    sh = (1e-6, 1e-3, 0.006)[level]
    assert_near(
        source.table(), table, **bounds, opacities=1 / 500, colors=1 / 510 / SH_DC + 1e-6, sh=sh
    )


def test_sections_follow_one_another(tmp_path):
    """The second has no SH: zeros."""
    tables = near_grey(9, 1), near_grey(6, 0, seed=1)
    again = open_scene(ksplat(tmp_path / "a.ksplat", 1, *tables)).table()
    assert again.sh.shape == (15, 4, 3)
    np.testing.assert_allclose(again.means[9:], tables[1].means, atol=1.3e-4)
    assert not again.sh[9:, 1:].any()


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (1, b"\0", "0.0"),
        (20, b"\x07", "level 7"),
        (4, b"\xff\xff\xff\xff", "sections"),
        (4096 + 40, b"\x05", "SH degree 5"),
        (4096, b"\xff\xff\xff\x7f", "of 22 rows"),
        (4096 + 4, b"\xff\xff\xff\xff", "bytes more"),
        (4096 + 8, b"\0\0\0\0", "buckets"),
        (4096 + 12, b"\x01\0\0\0", "buckets"),
    ],
)
def test_a_damaged_file_is_refused(place, value, words, tmp_path):
    raw = bytearray(ksplat(tmp_path / "a.ksplat", 1, near_grey(19, 1)).read_bytes())
    raw[place : place + len(value)] = value
    (tmp_path / "b.ksplat").write_bytes(raw)
    with pytest.raises(InputError, match=words):
        open_scene(tmp_path / "b.ksplat").table()
