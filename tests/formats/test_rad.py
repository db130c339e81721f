"""Spark's .rad: every encoding of its columns, its trees and its palettes; lies are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rad_files import PLAIN, USUAL, framed, rad
from splat_tables import assert_near, random_table

from gsedit.errors import InputError
from gsedit.formats.registry import open_scene

EXACT = dict.fromkeys(("means", "angle", "log_scales", "opacities", "colors", "sh"), 2e-3)
USUAL_STEPS = {"means": 0, "angle": 0.04, "log_scales": 0.05, "opacities": 1 / 500,
               "colors": 0.02, "sh": 1 / 250}  # fmt: skip
HALVES = {
    **USUAL, "center": "f16_lebytes", "alpha": "f16", "rgb": "f16", "scales": "ln_f16",
    "orientation": "f16", "sh1": "f16", "sh2": "s8_delta", "sh3": "f32",
}  # fmt: skip


def table_of(rows: int, degree: int = 2):
    """Light in (-1, 1), where the ranges of the test's files end."""
    table = random_table(rows, degree)
    sh = np.tanh(table.sh)
    return table.replace(sh=sh, means=np.tanh(table.means))


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize(
    ("encodings", "bounds"),
    [
        (PLAIN, EXACT),
        (USUAL, USUAL_STEPS),
        (HALVES, USUAL_STEPS | {"means": 1e-3}),
        ({**USUAL, "center": "f16", "rgb": "r8"}, USUAL_STEPS | {"means": 1e-3}),
    ],
    ids=["plain", "usual", "halves", "others"],
)
def test_columns_are_read_within_their_steps(encodings, bounds, degree, tmp_path):
    table = table_of(90, degree)
    source = open_scene(rad(tmp_path / "a.rad", table, encodings, rows=40))
    assert (source.count, source.header.degree, source.notes) == (90, degree, ())
    assert_near(source.table(), table, **bounds)


def test_of_a_tree_the_leaves_are_the_scene(tmp_path):
    table, children = table_of(90), np.zeros(90, int)
    children[[0, 1, 2, 50]] = 4
    source = open_scene(rad(tmp_path / "a.rad", table, PLAIN, rows=40, children=children))
    assert source.count == 86
    assert source.notes == ("merged Gaussians of coarser levels left out: 4",)
    assert_near(source.table(), table[children == 0], **EXACT)


def test_light_may_be_in_a_palette(tmp_path):
    table = table_of(90, 3)
    labels = np.random.default_rng(0).integers(0, 90, 90)
    source = open_scene(rad(tmp_path / "a.rad", table, PLAIN, rows=40, labels=labels))
    sh = np.concatenate((table.sh[:, :1], table.sh[labels, 1:]), 1)
    assert_near(source.table(), table.replace(sh=sh), **EXACT)


def test_chunks_may_be_files_beside_it(tmp_path):
    table = table_of(90)
    path = rad(tmp_path / "a.rad", table, PLAIN, rows=40, beside=True)
    assert_near(open_scene(path).table(), table, **EXACT)
    (tmp_path / "a-1.radc").rename(tmp_path.parent / "a-1.radc")
    with pytest.raises(InputError, match="names a file"):
        open_scene(path)
    (tmp_path / "a-1.radc").symlink_to(tmp_path.parent / "a-1.radc")
    with pytest.raises(InputError, match="leaves the dataset folder"):
        open_scene(path)


def exchanged(path: Path, old: bytes, new: bytes) -> Path:
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(raw.replace(old, new))
    return path


WRONG = {
    "newer": (b'"version": 1, "type"', b'"version": 9, "type"', "RAD 9"),
    "rows": (b'"count": 90', b'"count": 91', "not the 91 rows"),
    "encoding": (b'"r8_delta"', b'"r9_delta"', "unknown"),
    "column": (b'"alpha"', b'"alphx"', "no alpha"),
    "many rows": (b'"count": 40', b'"count": 41', "are needed"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_lies_is_refused_in_one_line(name, tmp_path):
    old, new, message = WRONG[name]
    path = rad(tmp_path / "a.rad", table_of(90), rows=40)
    if name == "many rows":
        exchanged(path, b'"count": 90', b'"count": 92')
    with pytest.raises(InputError, match=message) as error:
        open_scene(exchanged(path, old, new)).table()
    assert str(path) in str(error.value)


def test_a_chunk_that_is_named_many_times_is_refused(tmp_path):
    """It would unpack to any size."""
    raw = rad(tmp_path / "a.rad", table_of(45), PLAIN).read_bytes()
    length = int.from_bytes(raw[4:8], "little")
    meta = json.loads(raw[8 : 8 + length])
    meta |= {"count": 20 * 45, "chunks": 20 * meta["chunks"]}
    path = tmp_path / "b.rad"
    path.write_bytes(framed(b"RAD0", meta) + raw[raw.index(b"RADC") :])
    with pytest.raises(InputError, match="overlap"):
        open_scene(path)
