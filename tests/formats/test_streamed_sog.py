"""Streamed SOG: levels of detail in bounded folders, read as splat-transform writes it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from splat_tables import assert_near, random_table

from gsedit.errors import InputError, UsageError
from gsedit.formats.registry import open_scene
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SplatTable
from gsedit.toolkit import streamed
from gsedit.toolkit.streamed import write_streamed

TINY = Path(__file__).parents[1] / "data" / "splats"
BOUNDS = {"means": 2e-3, "angle": 0.03, "log_scales": 0.3, "opacities": 1 / 510, "colors": 0.3}


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    monkeypatch.setattr(streamed, "LEAF_ROWS", 40)
    monkeypatch.setattr(streamed, "CHUNK_ROWS", 100)


def written(folder: Path, table: SplatTable, **options) -> dict[str, Any]:
    """Write a scene and every second row of it; the index."""
    write_streamed(folder, [table, table[::2]], antialiased=True, **options)
    return json.loads((folder / "lod-meta.json").read_text())


def leaves(node: dict[str, Any]) -> list[dict[str, Any]]:
    if "lods" in node:
        return [node]
    return [leaf for child in node["children"] for leaf in leaves(child)]


def sorted_rows(table: SplatTable) -> SplatTable:
    return table[np.lexsort(table.means.T)]


def changed(tmp_path: Path, **changes) -> Path:
    index = written(tmp_path / "a", random_table(120, 1)) | changes
    (tmp_path / "a" / "lod-meta.json").write_text(json.dumps(index))
    return tmp_path / "a"


def test_the_finest_level_is_read_within_its_steps(tmp_path):
    table = random_table(300, 1)
    index = written(tmp_path, table)
    source = open_scene(tmp_path)
    assert (source.count, source.header.degree, source.header.antialiased) == (300, 1, True)
    assert source.notes == ("level 0 of detail was read, 1 coarser left out",)
    assert index["counts"] == [300, 150]
    again = source.table()
    order = np.array([np.abs(table.means - mean).sum(1).argmin() for mean in again.means])
    assert len({*order}) == 300
    assert_near(again, table[order], **BOUNDS, sh=1.0)


def test_folders_and_leaves_are_bounded_and_whole(tmp_path):
    """A folder's rows are the runs of its leaves, none twice, of one level."""
    table = random_table(300, 0)
    index = written(tmp_path, table)
    runs: dict[int, list[tuple[int, int, str]]] = {}
    for leaf in leaves(index["tree"]):
        for level, run in leaf["lods"].items():
            assert run["count"] <= 40
            runs.setdefault(run["file"], []).append((run["offset"], run["count"], level))
    assert sorted(runs) == [*range(len(index["filenames"]))]
    for file, found in runs.items():
        rows = json.loads((tmp_path / index["filenames"][file]).read_text())["count"]
        assert rows <= 100
        assert len({level for _, _, level in found}) == 1
        ends = np.cumsum([count for _, count, _ in sorted(found)])
        assert [offset for offset, _, _ in sorted(found)] == [0, *ends[:-1]]
        assert ends[-1] == rows


def test_boxes_hold_the_ellipsoids_of_all_levels(tmp_path):
    table = random_table(200, 0)
    tree = written(tmp_path, table)["tree"]
    axes = rotations(table.quats.astype(np.float64)) * table.scales[:, None]
    reach = np.sqrt(np.square(axes).sum(2))
    np.testing.assert_allclose(tree["bound"]["min"], (table.means - reach).min(0), rtol=1e-6)
    np.testing.assert_allclose(tree["bound"]["max"], (table.means + reach).max(0), rtol=1e-6)
    for child in tree["children"]:
        assert (np.array(child["bound"]["min"]) >= tree["bound"]["min"]).all()
        assert (np.array(child["bound"]["max"]) <= tree["bound"]["max"]).all()


def test_rows_at_one_place_are_one_leaf(tmp_path):
    table = random_table(100, 0)
    table = table.replace(means=np.zeros_like(table.means))
    assert len(leaves(written(tmp_path, table)["tree"])) == 1
    assert open_scene(tmp_path).count == 100


def test_files_that_exist_are_kept(tmp_path):
    table = random_table(60, 0)
    written(tmp_path, table)
    with pytest.raises(UsageError, match="already exists"):
        written(tmp_path, table)
    written(tmp_path, table, overwrite=True)


def test_a_scene_of_splat_transform_is_read():
    """Version 2.7.1 wrote it from tiny.ply, with half of its rows as level 1."""
    source, whole = open_scene(TINY / "tiny-streamed"), open_scene(TINY / "tiny.sog")
    assert source.count == 128
    again, expected = sorted_rows(source.table()), sorted_rows(whole.table())
    assert_near(again, expected, **{**BOUNDS, "opacities": 1 / 255}, sh=0.2)


def test_the_environment_is_read_too(tmp_path):
    folder = changed(tmp_path, environment="sky/meta.json")
    shutil.copytree(folder / "1_0", folder / "sky")
    source = open_scene(folder / "lod-meta.json")
    assert source.count == 120 + 60
    assert source.notes[1] == "the environment was read too: 60 Gaussians"
    assert len(source.table()) == 180


def run(count: int, offset: int = 0, file: int = 0) -> dict[str, Any]:
    return {"bound": {}, "lods": {"0": {"file": file, "offset": offset, "count": count}}}


WRONG = {
    "newer": ({"version": 2}, "version 2"),
    "up": ({"filenames": ["../b/meta.json"] * 9}, "leaves its folder"),
    "root": ({"filenames": ["/etc/meta.json"] * 9}, "absolute"),
    "itself": ({"filenames": ["lod-meta.json"] * 9, "tree": run(1)}, "no meta.json"),
    "missing": ({"filenames": ["9_9/meta.json"], "tree": run(1)}, "names a scene"),
    "twice": ({"filenames": ["0_0/meta.json"] * 9}, "two files are named"),
    "overlap": ({"tree": {"children": [run(9), run(9, 8)]}}, "overlap"),
    "beyond": ({"tree": run(101)}, "overlap"),
    "no file": ({"tree": run(1, 0, 99)}, "in file 99"),
    "empty": ({"tree": run(0)}, "no leaf"),
    "deep": ({"tree": [[]]}, "no object"),
}


@pytest.mark.parametrize("name", WRONG)
def test_an_index_that_lies_is_refused_in_one_line(name, tmp_path):
    changes, message = WRONG[name]
    with pytest.raises(InputError, match=message) as error:
        open_scene(changed(tmp_path, **changes)).table()
    assert "lod-meta.json" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    folder = changed(tmp_path)
    shutil.move(folder / "0_0", tmp_path / "elsewhere")
    (folder / "0_0").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="leaves the dataset folder"):
        open_scene(folder)
