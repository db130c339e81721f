"""Cameras beside a scene: `fit` writes them, `render` and `edit` use them."""

from __future__ import annotations

from dataclasses import replace

import torch
from command_line import gsedit, stub_fit

from gsedit import load_dataset
from gsedit.datasets.cameras_json import read_cameras, write_cameras


def test_fit_writes_the_cameras_of_the_photos(monkeypatch, photos, tmp_path):
    stub_fit(monkeypatch)
    assert gsedit("fit", photos, "-o", tmp_path / "out" / "bear.ply").exit_code == 0
    views = load_dataset(photos).views
    recorded = read_cameras(tmp_path / "out" / "cameras.json")
    assert [v.name for v in recorded] == [v.name for v in views]
    assert [v.camera.fx for v in recorded] == [v.camera.fx for v in views]


def test_render_uses_them_unless_it_is_told_where_to_look_from(scene, photos, tmp_path):
    write_cameras(load_dataset(photos).views, tmp_path / "cameras.json")
    words = ["render", scene, "--size", 16, "-f", "-o", tmp_path / "out"]
    recorded = gsedit(*words, "--views", "0,2")
    assert [line.rsplit("/", 1)[1] for line in recorded.stdout.split()] == [
        "000_0.png",
        "002_2.png",
    ]
    assert str(tmp_path / "cameras.json") in recorded.stderr
    assert gsedit(*words, "--views", "3").exit_code == 2
    assert "view_000" in gsedit(*words, "--up", "z", "--count", 1).stdout
    (tmp_path / "cameras.json").unlink()
    missing = gsedit(*words, "--views", "0")
    assert missing.exit_code == 2
    assert "cameras.json" in missing.stderr


def test_cameras_that_see_nothing_are_left_aside(scene, tmp_path, photos):
    views = load_dataset(photos).views
    away = torch.eye(4, dtype=torch.float64)
    away[2, 3] = -1e6  # the scene is behind
    cameras = [replace(view.camera, world_to_camera=away) for view in views]
    elsewhere = [replace(view, camera=camera) for view, camera in zip(views, cameras)]
    write_cameras(elsewhere, tmp_path / "cameras.json")
    result = gsedit("render", scene, "--size", 16, "--count", 1, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert "none of these cameras sees the scene" in result.stderr


def test_photos_are_never_made_larger_and_that_is_said(scene, photos, tmp_path):
    out = tmp_path / "out"
    result = gsedit("render", scene, "--data", photos, "--views", "0", "--size", 64, "-o", out)
    assert "the photos have 8x6 pixels: views are not made larger (--size 64)" in result.stderr


def test_places_are_three_numbers_and_need_no_photos(scene, photos, tmp_path):
    words = ["render", scene, "--size", 16, "--count", 1, "-o", tmp_path / "out"]
    for wrong in (["--from", "1,2"], ["--look-at", "a,b,c"], ["--from", "0,0,nan"],
                  ["--from", "0,0,1", "--data", photos]):  # fmt: skip
        assert gsedit(*words, *wrong).exit_code == 2
    placed = gsedit(*words, "--from", "-5,0,0", "--look-at", "0,0,0", "--up", "z")
    assert placed.exit_code == 0, placed.stderr
    assert placed.stdout.split() == [str(tmp_path / "out" / "view_000.png")]
