"""`gsedit metrics`: what can be compared with what, the record, and what it refuses."""

import json
import shutil

import pytest
from command_line import EDIT, answer, gsedit
from PIL import Image

from gsedit.views.view_list_files import read_view_list


@pytest.fixture(scope="module")
def folder(room, tmp_path_factory):
    """An edit of the room, and the unedited scene beside it."""
    place = tmp_path_factory.mktemp("edit") / "room"
    shutil.copytree(room, place)
    answer("edit", place / "room.ply", *EDIT, "-o", place / "out")
    return place


def test_masks_that_the_edit_did_not_know(folder, tmp_path):
    names = [each.name for each in read_view_list(folder / "out" / "views.json").viewpoints]
    for name in names[1:6]:
        Image.new("L", (32, 32)).save(tmp_path / f"{name}.png")  # the subject is nowhere
    record = answer("metrics", folder / "out", "--subject-masks", tmp_path)
    outside = record["measured"]["rmse_outside_masks"]["all"]
    assert outside["views"] == 5
    assert outside["value"] > record["measured"].get("rmse_outside_region", outside)["value"] / 2
    other = tmp_path / "another" / "other.png"  # of a view that is not measured
    other.parent.mkdir()
    Image.new("L", (32, 32)).save(other)
    assert gsedit("metrics", folder / "out", "--subject-masks", other.parent).exit_code == 3
    other.rename(tmp_path / "other.png")
    record = answer("metrics", folder / "out", "--subject-masks", tmp_path)
    assert record["measured"]["rmse_outside_masks"]["all"] == outside


def test_two_people_measure_the_same(folder, tmp_path):
    """By the list of views of the edit: against the unedited scene, from other cameras' files."""
    scene, views = folder / "out" / "scene.ply", tmp_path / "views.json"
    first = answer("metrics", folder / "out", "--save-views", views)
    second = answer("metrics", 
        scene, "--against", folder / "room.ply", "--views", views,
        "--region", folder / "out" / "region.npy",
    )  # fmt: skip
    for name in ("rmse_to_unedited", "psnr_to_unedited", "ssim_to_unedited"):
        assert second["measured"][name] == first["measured"][name]
    warps = [name for name in first["measured"] if name.startswith("warp_renders")]
    assert warps
    assert all(second["measured"][name] == first["measured"][name] for name in warps)
    assert {"psnr_to_targets", "seconds"} <= set(second["not_measured"])
    assert read_view_list(views).roles == read_view_list(folder / "out" / "views.json").roles


def test_the_folder_of_a_painting_measures_what_the_painting_told(folder, tmp_path):
    larger = "--size", 48, "--set", "edit_size=64"
    answer("edit", folder / "room.ply", "as a woodcut", *larger, "-o", tmp_path / "out")
    told = json.loads((tmp_path / "out" / "edit.json").read_text())["measured"]
    measured = answer("metrics", tmp_path / "out")["measured"]
    for name in ("psnr_to_targets", "psnr_to_edits_alone", "psnr_to_unedited", "rmse_to_unedited"):
        for role, own in told[name].items():
            same = {"value": pytest.approx(own["value"], rel=5e-3), "views": own["views"]}
            assert {**measured[name][role], **same} == measured[name][role], name


def test_pictures_by_the_names_of_the_views(folder):
    out = folder / "out"
    pictures = out / "targets"
    views = ("--views", out / "views.json", "--size", 24)
    record = answer("metrics", out / "scene.ply", "--against", pictures, *views)
    assert record["against_is"] == "pictures"
    assert record["measured"]["psnr_to_targets"]["edited"]["views"] == len([*pictures.iterdir()])
    assert "held_out" not in record["measured"]["psnr_to_targets"]
    assert "psnr_to_targets at held_out views" in record["not_measured"]
    assert "rmse_to_unedited" in record["not_measured"]


def test_photos_of_a_dataset(folder, photos, tmp_path):
    record = answer("metrics", folder / "room.ply", "--against", photos, "--size", 16)
    assert record["against_is"] == "photos"
    assert record["views"] == {"edited": 2, "held_out": 1}
    assert set(record["measured"]["ssim_to_targets"]) == {"edited", "held_out"}


def test_an_edit_whose_unedited_scene_is_gone(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder / "out", copy)
    record = json.loads((copy / "edit.json").read_text())
    (copy / "edit.json").write_text(json.dumps({**record, "scene": "gone/room.ply"}))
    done = gsedit("metrics", copy)
    assert done.exit_code == 3
    (copy / "edit.json").rename(copy / "metrics.unfinished.jsonl")
    assert gsedit("metrics", copy).exit_code == 3
