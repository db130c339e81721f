"""The table of `gsedit bench stability`: a row for each edge case and dtype."""

import json
from dataclasses import asdict, replace

import torch

from gsedit.bench.renderer import stability
from gsedit.bench.renderer.stability import EDGE_CASES

DTYPES = (torch.float32, torch.float64)


BY_NAME = {case.name: case for case in EDGE_CASES}


def test_the_table_shows_errors_refusals_and_what_is_not_finite():
    names = ("ordinary crowd", "needle 1e3 : 1e-3", "means nan")
    found = [
        stability.measure_edge_case(BY_NAME[name], dtype) for name in names for dtype in DTYPES
    ]
    text = stability.table(found)
    assert text.count("\n| **") == 2
    assert f"| {found[0].image_error:.1e} | {found[0].gradient_error:.1e} |" in text
    assert "means[57, 2] is nan" in text
    broken = replace(found[0], outcome="not finite", image_error=None, gradient_error=None)
    assert stability.table([broken]).count("**not finite**") == 2
    for row in (*found, broken):
        assert json.loads(json.dumps(asdict(row), allow_nan=False))["name"] == row.name
