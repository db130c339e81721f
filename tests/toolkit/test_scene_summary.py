"""A scene in a few numbers, read a part at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from splat_tables import random_table

from gsedit.errors import InputError
from gsedit.formats.streams import SceneHeader, SceneSource, in_blocks
from gsedit.scene.table import SplatTable
from gsedit.toolkit.scene_summary import COLUMNS, QUANTILES, quantiles_of, summarise


def source_of(table: SplatTable, rows: int = 7) -> SceneSource:
    path = Path("scene.ply")
    header = SceneHeader(table.degree)
    return SceneSource(path, "made here", header, len(table), lambda: in_blocks(table, rows))


def test_quantiles_are_values_of_the_scene():
    values = np.random.default_rng(0).permutation(101).astype(np.float32)
    assert quantiles_of(values, QUANTILES) == (0.0, 1.0, 50.0, 99.0, 100.0)
    assert quantiles_of(np.float32([3]), QUANTILES) == (3.0,) * len(QUANTILES)


def test_the_numbers_are_those_of_the_whole_scene():
    table = random_table(101, 1)
    summary, _ = summarise(source_of(table))
    ordered = np.sort(table.scales, axis=1)
    expected = {
        "x": table.means[:, 0],
        "opacity": table.opacities,
        "scale": table.scales.ravel(),
        "elongation": ordered[:, 2] / ordered[:, 1],
        "green": table.colors[:, 1],
    }
    for name, values in expected.items():
        nearest = [np.sort(values)[round(q * (len(values) - 1))] for q in QUANTILES]
        np.testing.assert_allclose(getattr(summary, name), nearest, rtol=1e-5)
    assert (summary.gaussians, summary.sh_degree, summary.quantiles_of_every) == (101, 1, 1)


def test_invalid_rows_are_counted_and_in_no_number():
    table = random_table(20)
    table.means[3, 1] = np.nan
    table.quats[8] = 0
    summary, _ = summarise(source_of(table))
    assert (summary.gaussians, summary.invalid) == (18, 2)
    assert summary.first_invalid == "row 3 (from 0): column y is nan"
    assert np.isfinite([getattr(summary, name) for name in COLUMNS]).all()
    with pytest.raises(InputError, match="all 2 rows"):
        summarise(source_of(table[[3, 8]]))
