"""The middle of a capture as a selection: its cameras are named or lie beside the scene."""

from __future__ import annotations

import json

import torch
from command_line import gsedit, one_line

from gsedit import View, orbit
from gsedit.datasets.cameras_json import write_cameras
from gsedit.formats.scenes import load


def test_what_the_cameras_stand_around_is_kept_and_counted(scene, tmp_path):
    before, out = load(scene), tmp_path / "alone.ply"
    cameras = orbit(before, 6, 32)
    path = tmp_path / "views" / "cameras.json"
    write_cameras([View(str(i), c, torch.zeros(32, 32, 3)) for i, c in enumerate(cameras)], path)
    done = gsedit("filter", scene, "--data", path, "--where", "middle(0.05)", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert f"filter: kept {len(load(out)):,} of {len(before):,}" in done.stderr
    assert 0 < len(load(out)) < len(before)


def test_within_needs_cameras(scene, tmp_path):
    done = gsedit("filter", scene, "--where", "middle(0.5)", "-o", tmp_path / "a.ply")
    assert done.exit_code == 2
    assert one_line(done.stderr)
    assert "--data" in done.stderr


def test_the_cameras_are_those_of_the_scene_and_not_of_one_that_is_merged(scene, tmp_path):
    """Also behind a verb that names another scene."""
    other = tmp_path / "elsewhere" / "other.ply"
    other.parent.mkdir()
    other.write_bytes(scene.read_bytes())
    cameras = orbit(load(scene), 6, 32)
    views = [View(str(i), c, torch.zeros(32, 32, 3)) for i, c in enumerate(cameras)]
    write_cameras(views, scene.with_name("cameras.json"))
    alone = gsedit("filter", scene, "--where", "middle(0.05)", "--dry-run", "--json")
    words = ("then", "filter", "--where", "middle(0.05)", "--dry-run", "--json")
    done = gsedit("merge", scene, other, *words)
    assert done.exit_code == 0, done.stderr
    kept = [json.loads(each.stdout)["gaussians"] for each in (alone, done)]
    assert kept[1] == 2 * kept[0]
