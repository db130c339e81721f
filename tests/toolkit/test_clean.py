"""check, repair and clean: each law finds what it is about, and leaves healthy scenes alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from defective import invalid, plane, splat, unwanted

from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.formats.validity import invalid_rows
from gsedit.scene.table import SPLAT_FIELDS, SplatTable, concatenate_tables
from gsedit.toolkit import Clean, Limits, apply, clean, find_defects, repair
from gsedit.toolkit import check as check_file
from gsedit.toolkit.defects import REASONS
from rasterizer import look_at


def names(table: SplatTable, limits: Limits | None = None) -> dict[str, list[int]]:
    """The rows of every reason but the empty one."""
    why = find_defects(table, limits or Limits())
    return {REASONS[i]: np.flatnonzero(why == i).tolist() for i in np.unique(why) if i}


def written(table: SplatTable, path):
    write_scene(path, SceneHeader(table.degree), in_blocks(table))
    return open_scene(path)


def test_a_healthy_scene_stays_as_it_is():
    table = plane()
    assert names(table) == {}
    for same in (clean(table), repair(table)):
        for name in SPLAT_FIELDS:
            np.testing.assert_array_equal(getattr(same, name), getattr(table, name))


def test_every_unwanted_gaussian_is_found_for_its_reason():
    table, rows = unwanted()
    said = []
    assert names(table) == rows
    kept = clean(table, say=said.append)
    np.testing.assert_array_equal(kept.means, plane().means)
    assert sorted(said) == sorted(f"1 {name}" for name in rows)


@pytest.mark.parametrize("name", ["invisible", "giant", "floater", "needle", "duplicates"])
def test_a_reason_can_be_switched_off(name):
    table, rows = unwanted()
    off = replace(Limits(), **{name: False if name == "duplicates" else None})
    found = names(table, off)
    gone = {name.removesuffix("s")}
    assert not gone & set(found)
    gone |= {"needle"} if name == "giant" else set()  # the giant holds the end of the needle
    assert all(found[other] == rows[other] for other in rows if other not in gone)


def test_scenes_a_million_wide_cost_what_small_ones_do():
    base, draw = plane(), np.random.default_rng(1)
    far = (draw.normal(size=(50, 3)) * 1e6).astype(np.float32)
    outliers = [splat(at, (0.05, 0.05, 0.05)) for at in far]
    why = find_defects(concatenate_tables([base, *outliers]))
    assert (why[len(base) :] == REASONS.index("floater")).all()
    assert not why[: len(base)].any()


def test_a_sky_stays():
    near = splat((0, 0, 0.9), (0.5, 0.5, 0.05))
    far = splat((0, 0, 9), (5, 5, 0.5))
    assert names(concatenate_tables([plane(), near, far])) == {}


def test_what_no_camera_sees_goes():
    behind = splat((0, 0, 2.5), (0.05, 0.05, 0.05))
    shown = splat((0, 0, 0.1), (0.05, 0.05, 0.05))
    table = concatenate_tables([plane(), behind, shown])
    off = Limits(floater=None)
    eye, up = torch.tensor([0.0, 0.1, 2.0]), torch.tensor([0.0, 1.0, 0.0])
    camera = look_at(eye, torch.zeros(3), up, 60.0, 64, 64)
    kept = clean(table, off, cameras=[camera])
    assert behind.means[0, 2] not in kept.means[:, 2]
    assert shown.means[0, 2] in kept.means[:, 2]
    assert len(kept) > 0.95 * len(table)  # some discs lie under others
    assert len(clean(table, off)) == len(table)


def test_marked_scenes_keep_every_row(tmp_path):
    table, rows = unwanted()
    path = tmp_path / "reasons.npy"
    said: list[str] = []
    marked = apply(table, Clean(mark=True, reasons=path), say=said.append)
    assert len(marked) == len(table)
    for name, where in rows.items():
        assert (marked.extra["defect"][where] == REASONS.index(name)).all()
    np.testing.assert_array_equal(np.load(path), marked.extra["defect"])
    assert "1 needle (defect 6)" in said


def test_repair_mends_what_it_says():
    table, _ = invalid()
    said: list[str] = []
    mended = repair(table, said.append)
    assert not invalid_rows(mended).any()
    gone = [0, 1, 4, 7, 8]
    kept = np.delete(np.arange(len(table)), gone)
    np.testing.assert_array_equal(mended.means, table.means[kept])
    at = {row: int(np.flatnonzero(kept == row)[0]) for row in (2, 3, 5, 6, 9)}
    np.testing.assert_array_equal(mended.quats[at[2]], [1, 0, 0, 0])
    assert mended.scales[at[3]].min() > 0
    assert mended.logit_opacities[[at[5], at[6]]].tolist() == [15, -15]
    assert mended.sh[at[9], 2, 1] == 0
    untouched = kept[kept > 9]
    np.testing.assert_array_equal(mended.sh[5:], table.sh[untouched])
    assert "2 infinite opacities became 15 or -15 (logits)" in said
    assert sum(int(line.split()[0]) for line in said if "removed" in line) == len(gone)


def test_check_names_every_row_of_a_file_that_load_refuses(tmp_path):
    broken, bad = invalid()
    table, rows = unwanted()
    both = concatenate_tables([broken, table[len(plane()) :]])
    report = check_file(written(both, tmp_path / "scene.ply"))
    found = {each.defect.name: each.rows.tolist() for each in report.found}
    del rows["duplicate"]  # of row 7, which is broken here
    assert found == {**bad, **rows}
    assert report.refused == 10
    assert report.gaussians == len(both)
