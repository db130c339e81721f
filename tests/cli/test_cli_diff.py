"""`gsedit diff`: tables, JSON, the picture, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from bad_files import ply_bytes, scene_table
from command_line import files, gsedit, one_line
from PIL import Image

from gsedit import orbit
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.formats.scenes import load, save


@pytest.fixture
def other(scene, tmp_path):
    """Another scene, with cameras beside it, of which the first has none."""
    folder = tmp_path / "other"
    folder.mkdir()
    path = folder / "other.ply"
    path.write_bytes(ply_bytes(scene_table()[:4]))
    cameras = orbit(load(path), 3, 32)
    views = [Viewpoint(f"shot{i}", camera) for i, camera in enumerate(cameras)]
    write_cameras(views, folder / "cameras.json")
    return path


def test_diff_says_what_differs(scene, other, tmp_path):
    out = tmp_path / "diff.png"
    result = gsedit("diff", scene, other, "--size", 24, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert "other/cameras.json" in result.stderr
    assert "-20.0 %" in result.stdout
    assert "worst" in result.stdout
    assert "80.0% of the first scene's Gaussians are in the second" in result.stdout
    assert max(map(len, result.stdout.splitlines())) < 120
    assert Image.open(out).size[0] > 800


def test_diff_says_how_to_bring_scenes_into_one_frame(scene, tmp_path):
    far = tmp_path / "far away.ply"
    placed = load(scene)
    save(replace(placed, means=placed.means + 1000), far)
    result = gsedit("diff", scene, far, "--size", 16, "--count", 1)
    assert result.exit_code == 0, result.stderr
    assert "-> the scenes lie in different places" in result.stdout
    assert f"gsedit align '{far}' --to {scene} -o ALIGNED.ply" in result.stdout
    shifted, mirrored = tmp_path / "shifted.ply", tmp_path / "mirrored.ply"
    placed = replace(placed, means=placed.means + torch.tensor([0.0, 0.0, 50.0]))
    save(placed, shifted)
    save(replace(placed, means=placed.means * torch.tensor([1.0, 1.0, -1.0])), mirrored)
    result = gsedit("diff", shifted, mirrored, "--size", 16, "--count", 1)
    assert "gsedit transform --mirror z" in result.stdout
    assert "gsedit align" not in result.stdout  # which no turn of a mirrored scene satisfies


def test_diff_as_json(scene, other):
    result = gsedit("diff", scene, other, "--size", 24, "--count", 2, "--json")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout.splitlines()[-1])
    assert record["type"] == "diff"
    assert record["counts"] == [5, 4]
    assert len(record["views"]) == 2
    assert record["worst_view"] in {view["name"] for view in record["views"]}


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["missing.ply"], 3, "missing.ply"),
        (["OTHER", "-o", "a.jpg"], 2, "name a .png file"),
        (["OTHER", "--look-at", "1,2"], 2, "3 finite numbers"),
    ],
)
def test_diffs_that_cannot_be_made(scene, other, tmp_path, monkeypatch, words, code, message):
    monkeypatch.chdir(tmp_path)
    before = set(files(tmp_path))
    result = gsedit("diff", scene, *(other if word == "OTHER" else word for word in words))
    assert result.exit_code == code
    assert message in result.stderr
    assert one_line(result.stderr)
    assert set(files(tmp_path)) == before
