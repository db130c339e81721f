"""mkkellogg's .ksplat, against files that are written here by its published layout."""

from __future__ import annotations

import pytest
from ksplat_files import ksplat, near_grey
from splat_tables import assert_near

from gsedit.formats.files import open_scene
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
