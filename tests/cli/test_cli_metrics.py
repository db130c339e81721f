"""`gsedit metrics`: what can be compared with what, the record, and what it refuses."""

from __future__ import annotations

import json

import pytest
import torch
from command_line import gsedit
from PIL import Image

import gsedit as library
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.view_list_files import read_view_list
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small edit, as `gsedit edit` leaves it, and the unedited scene beside it."""
    place = tmp_path_factory.mktemp("edit")
    scene = surface_gaussians(demo_scene(), 400, torch.Generator().manual_seed(0))
    library.save(scene, place / "demo.ply")
    cameras = [Viewpoint(f"{i}.png", c) for i, c in enumerate(ring_cameras(demo_scene(), 72, 32))]
    write_cameras(cameras[:9], place / "cameras.json")
    done = gsedit(
        "edit", place / "demo.ply", "as bronze", "-o", place / "out", "--editor", "closed-form",
        "--size", 32, "--batches", 1, "--views", 3, "--update-steps", 5, "--steps", 3,
        "--patch", 16, "--overlap", 1, "--coverage", 1,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    return place


def record_of(*words):
    done = gsedit("metrics", *words, "--json")
    assert done.exit_code == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return next(line for line in lines if line["type"] == "metrics")


def test_masks_that_the_edit_did_not_know(folder, tmp_path):
    names = [each.name for each in read_view_list(folder / "out" / "views.json").viewpoints]
    for name in names[1:6]:
        Image.new("L", (32, 32)).save(tmp_path / name)  # the subject is nowhere
    record = record_of(folder / "out", "--subject-masks", tmp_path)
    outside = record["measured"]["rmse_outside_masks"]["all"]
    assert outside["views"] == 5
    assert outside["value"] > record["measured"].get("rmse_outside_region", outside)["value"] / 2
    Image.new("L", (32, 32)).save(tmp_path / "other.png")
    done = gsedit("metrics", folder / "out", "--subject-masks", tmp_path)
    assert done.exit_code == 3
    assert "other.png belongs to no view" in done.stderr


def test_two_people_measure_the_same(folder, tmp_path):
    """By the list of views of the edit: against the unedited scene, from other cameras' files."""
    scene, views = folder / "out" / "scene.ply", tmp_path / "views.json"
    first = record_of(folder / "out", "--save-views", views)
    second = record_of(
        scene, "--against", folder / "demo.ply", "--views", views,
        "--region", folder / "out" / "region.npy",
    )  # fmt: skip
    for name in ("rmse_to_unedited", "psnr_to_unedited", "ssim_to_unedited"):
        assert second["measured"][name] == first["measured"][name]
    assert second["measured"]["warp_renders_long"] == first["measured"]["warp_renders_long"]
    assert second["not_measured"]["psnr_to_targets"].startswith("there are no edited pictures")
    assert "seconds" in second["not_measured"]
    assert read_view_list(views).roles == read_view_list(folder / "out" / "views.json").roles


def test_pictures_by_the_names_of_the_views(folder):
    out = folder / "out"
    pictures = out / "targets"
    record = record_of(
        out / "scene.ply", "--against", pictures, "--views", out / "views.json", "--size", 24
    )
    assert record["against_is"] == "pictures"
    assert record["measured"]["psnr_to_targets"]["edited"]["views"] == len([*pictures.iterdir()])
    assert "held_out" not in record["measured"]["psnr_to_targets"]
    assert "psnr_to_targets at held_out views" in record["not_measured"]
    assert "rmse_to_unedited" in record["not_measured"]


def test_photos_of_a_dataset(folder, photos, tmp_path):
    record = record_of(folder / "demo.ply", "--against", photos, "--size", 16)
    assert record["against_is"] == "photos"
    assert record["views"] == {"edited": 2, "held_out": 1}
    assert set(record["measured"]["ssim_to_targets"]) == {"edited", "held_out"}


def test_an_edit_whose_unedited_scene_is_gone(folder, tmp_path):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(folder / "out", copy)
    record = json.loads((copy / "edit.json").read_text())
    (copy / "edit.json").write_text(json.dumps({**record, "scene": "gone/demo.ply"}))
    done = gsedit("metrics", copy)
    assert done.exit_code == 3
    assert "names the unedited scene gone/demo.ply, which is not there" in done.stderr
    (copy / "edit.json").rename(copy / "metrics.unfinished.jsonl")
    assert "edit that did not finish" in gsedit("metrics", copy).stderr
