"""`gsedit metrics`: what can be compared with what, the record, and what it refuses."""

from __future__ import annotations

import json

import pytest
import torch
from command_line import gsedit, one_line
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


def test_the_folder_of_an_edit_gives_the_numbers_of_its_record(folder):
    record = record_of(folder / "out")
    edit = json.loads((folder / "out" / "edit.json").read_text())
    measured, own = record["measured"], edit["measured"]
    for name, tolerance in (
        ("rmse_to_unedited", 1e-5),
        ("psnr_to_unedited", 1e-2),
        ("psnr_to_targets", 0.1),  # the pictures in the folder have 8 bits
    ):
        for role, mean in measured[name].items():
            assert mean["value"] == pytest.approx(own[name][role]["value"], abs=tolerance), name
            assert mean["views"] == own[name][role]["views"]
    for range_ in ("short", "long"):
        row = f"warp_renders_{range_}"
        for name in ("unedited", "edited", "excess", "compared"):
            assert measured[row][name] == pytest.approx(own[row][name], abs=1e-3)
    for kinds in (measured, own):
        by = {role: mean["against"] for role, mean in kinds["psnr_to_targets"].items()}
        assert by["edited"] == "the edits that the scene was fitted to"
    assert measured["seconds"] == edit["timings"]["total"]
    assert measured["evaluations"] == edit["work"]["network_evaluations"] > 0


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


def test_the_table_fits_80_columns_and_the_files_are_written(folder, tmp_path):
    out, picture = tmp_path / "record.json", tmp_path / "sheet.png"
    done = gsedit("metrics", folder / "out", "-o", out, "--picture", picture)
    assert done.exit_code == 0, done.stderr
    assert max(map(len, done.stdout.splitlines())) <= 80
    for words in ("PSNR to the edited views", "excess", "network evaluations", "not measured:"):
        assert words in done.stdout
    assert json.loads(out.read_text())["measured"]["rmse_to_unedited"]
    assert picture.stat().st_size > 1000
    assert gsedit("metrics", folder / "out", "-o", out).exit_code == 2


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((), 2, "nothing to compare with: add --against"),
        (("--against", "gone.ply"), 3, "gone.ply cannot be read"),
        (("--against", "{empty}"), 3, "is no folder of an edit (edit.json), of photos"),
        (("--against", "{pictures}"), 2, "nothing says from where the pictures in"),
        (("--against", "{edit}", "--data", "x"), 2, "already says which views: leave out --data"),
        (("--against", "{demo}", "-o", "x.txt"), 2, "x.txt: name a .json file"),
        (("--against", "{edit}/views.json"), 3, "is a list of views: give it with --views"),
        (("--against", "{edit}", "--region", "auto"), 2, "must be known: give the region.npy"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_line(folder, tmp_path, words, code, message):
    places = {
        "empty": tmp_path, "pictures": folder / "out" / "targets", "edit": folder / "out",
        "demo": folder / "demo.ply",
    }  # fmt: skip
    done = gsedit("metrics", folder / "demo.ply", *(word.format(**places) for word in words))
    assert done.exit_code == code
    assert message in done.stderr
    assert one_line(done.stderr)


def test_a_folder_that_is_no_edit_is_no_scene(tmp_path):
    done = gsedit("metrics", tmp_path)
    assert done.exit_code == 2
    assert "is no folder of an edit (no edit.json): name a scene file" in done.stderr


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
