"""Laws of the verbs that change a scene: order, selection, frames, cameras, and what is kept."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from bad_files import PLY_COLUMNS, ply_bytes, scene_table
from command_line import answer, gsedit
from PIL import Image

from gsedit import load, load_dataset
from gsedit.formats.files import open_scene
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import table_of
from gsedit.select.region import Region
from gsedit.toolkit import recolor, select
from gsedit.views.cameras_json import own_file, read_cameras, write_cameras


def means(path) -> np.ndarray:
    return load(path).means.numpy()


def count(scene, *words) -> int:
    """How many Gaussians `gsedit filter` would keep."""
    return answer("filter", scene, *words, "--dry-run")["gaussians"]


def test_steps_stand_in_the_order_of_the_command_line(scene, tmp_path):
    a, b, part = (tmp_path / f"{name}.ply" for name in ("a", "b", "part"))
    move, scale = ("--translate", "-1,0,0"), ("--scale", "2")
    answer("transform", scene, *move, *scale, "-o", a)
    answer("transform", scene, *scale, *move, "-o", b)
    np.testing.assert_allclose(means(a), 2 * (means(scene) - [1, 0, 0]), atol=1e-5)
    np.testing.assert_allclose(means(b), 2 * means(scene) - [1, 0, 0], atol=1e-5)
    answer("transform", scene, "--translate", "0,9,0", "--where", "x < 0", "-o", part)
    lift = 9.0 * (means(scene)[:, :1] < 0) * [0, 1, 0]
    np.testing.assert_allclose(means(part), means(scene) + lift, atol=1e-5)


def test_cameras_move_along(room, tmp_path):
    out = tmp_path / "moved.ply"
    words = ("--translate", "1,2,3", "--cameras", "-o", out, "then", "transform", "--scale", "3")
    answer("transform", room / "room.ply", *words)
    before, after = (read_cameras(path) for path in (room / "cameras.json", own_file(out)))
    for was, now in zip(before, after, strict=True):
        expected = 3 * (was.camera.center + torch.tensor([1.0, 2, 3], dtype=torch.float64))
        np.testing.assert_allclose(now.camera.center, expected, atol=1e-6)


def test_an_export_of_nerfstudio_comes_back_into_the_frame_of_its_photos(scene, tmp_path):
    turn, move = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), np.array([1.0, 2, 3])
    exported = tmp_path / "dataparser_transforms.json"  # x' = scale (R x + t)
    record = {"transform": np.column_stack((turn, move)).tolist(), "scale": 0.5}
    exported.write_text(json.dumps(record))
    original, out = open_scene(scene).table(), tmp_path / "back/splat.ply"
    answer("convert", scene, out, "--undo-dataparser", exported)
    back = open_scene(out).table()
    np.testing.assert_allclose(back.means, (original.means / 0.5 - move) @ turn, atol=1e-5)
    np.testing.assert_allclose(back.log_scales, original.log_scales + np.log(2), atol=1e-5)
    again = Similarity(turn, 0.5, 0.5 * move).table(back)
    np.testing.assert_allclose(again.sh, original.sh, atol=1e-5)
    for place in ((tmp_path / "beside.ply",), ("-o", tmp_path / "beside.ply")):
        done = gsedit("convert", scene, *place, "--undo-dataparser", exported)
        assert done.exit_code == 2  # the file beside it would be of another frame


def test_merge_reads_the_others_as_its_options_say(scene, tmp_path):
    other, bad, out = tmp_path / "other.spz", tmp_path / "bad.ply", tmp_path / "out.ply"
    answer("transform", scene, "--rotate", "180,0,0", "-o", other)  # as if the axes were RDF
    answer("merge", scene, other, "--spz-frame", "rdf", "-o", out)
    np.testing.assert_allclose(means(out)[5:], means(out)[:5], atol=1e-3)
    table = scene_table()
    table[3, PLY_COLUMNS.index("y")] = np.nan
    bad.write_bytes(ply_bytes(table))
    assert answer("merge", scene, bad, "--drop-invalid", "-o", out, "-f")["gaussians"] == 9


def test_an_invalid_row_is_named_by_its_place_in_the_file(scene, tmp_path):
    table = scene_table()
    table[:3, PLY_COLUMNS.index("x")] = -9
    table[3, PLY_COLUMNS.index("y")] = np.nan
    table[3, PLY_COLUMNS.index("x")] = 1
    scene.write_bytes(ply_bytes(table))
    done = gsedit("filter", scene, "--where", "x > -8", "-o", tmp_path / "out.ply")
    assert done.exit_code == 3
    assert "row 3 (from 0): column y is nan; 1 of 5 rows are invalid" in done.stderr


def test_recolor_takes_the_arguments_of_the_function(scene, tmp_path):
    out, before = tmp_path / "warm.ply", table_of(load(scene))
    words = ("--exposure", "0.5", "--temperature", 8000, "--curve", "0.25:0.35", "--tint=-0.2")
    answer("recolor", scene, *words, "--where", "x > 0", "-o", out)
    expected = recolor(
        before, exposure=0.5, temperature=8000.0, tint=-0.2, curve=((0.25, 0.35),), where="x > 0"
    )
    np.testing.assert_allclose(table_of(load(out)).sh, expected.sh, atol=1e-5)
    assert np.abs(expected.sh - before.sh).max() > 0.05


def test_what_is_recolored_is_decided_before_colors_change(scene, tmp_path):
    picture, out = tmp_path / "red.png", tmp_path / "out.ply"
    Image.new("RGB", (8, 8), (200, 30, 30)).save(picture)
    before = table_of(load(scene))
    inside = select(before, "luminance > 0.5")
    assert 0 < inside.sum() < len(inside)
    for more in ((), ("--palette", picture)):
        words = ("--exposure", -6, *more, "--opacity", 0.25, "--where", "luminance > 0.5")
        answer("recolor", scene, *words, "-o", out, "-f")
        after = table_of(load(out))
        np.testing.assert_allclose(after.opacities[inside], 0.25, atol=1e-5)
        np.testing.assert_array_equal(after.sh[~inside], before.sh[~inside])
        kept = after.logit_opacities[~inside]
        np.testing.assert_array_equal(kept, before.logit_opacities[~inside])


def test_selections_use_the_cameras_beside_the_scene(scene, photos, tmp_path):
    seen = count(scene, "--where", "seen(pixels=0.001)", "--data", photos)
    assert count(scene, "--where", f"seen('{photos}', 0.001)") == seen > 0
    mask = tmp_path / "0.png"
    Image.new("L", (8, 6), 255).save(mask)
    drawn = count(scene, "--region", mask, "--data", photos)
    assert count(scene, "--where", f"mask('{mask}')", "--data", photos) == drawn
    write_cameras(load_dataset(photos).views, scene.with_name("cameras.json"))
    assert count(scene, "--region", mask) == drawn
    other = tmp_path / "there/other.ply"  # a scene without cameras, which is merged behind
    other.parent.mkdir()
    other.write_bytes(scene.read_bytes())
    asked = ("filter", "--where", "seen(pixels=0.001)", "--dry-run")
    assert answer("merge", scene, other, "then", *asked)["gaussians"] == 2 * seen
    for words in (("merge", other, scene), ("transform", scene, "--scale", 2)):
        assert gsedit(*words, "then", *asked).exit_code == 2  # no cameras of this scene


def test_a_region_and_an_expression_are_an_intersection(scene):
    ball, both = "sphere(0,0,0,1.5)", ("--region", "sphere:0,0,0,1.5", "--where", "y >= 0")
    assert count(scene, *both) == count(scene, "--where", f"{ball} and y >= 0")
    assert count(scene, "--region", "all") == 5


def test_the_subject_is_an_expression_and_a_region(scene, monkeypatch):
    def find_subject(gaussians, cameras, *, with_carrier):
        return Region(torch.arange(len(gaussians)) < 2 + with_carrier, "the subject")

    monkeypatch.setattr("gsedit.select.finder.find_subject", find_subject)
    assert count(scene, "--region", "auto") == 2
    assert count(scene, "--where", "not subject()") == 3
    assert count(scene, "--where", "subject(base=True)") == 3


@pytest.mark.parametrize("first", ["filter", "convert"])
def test_flags_of_rows_fit_only_before_the_order_changes(first, scene, tmp_path):
    flags = tmp_path / "flags.npy"
    np.save(flags, np.arange(5) < 2)
    steps = {
        "filter": ("--where", f"grow(flags('{flags}'), 1) or x > 9"),
        "convert": ("--order", "morton"),
    }
    second = "convert" if first == "filter" else "filter"
    done = gsedit(first, scene, *steps[first], "then", second, *steps[second], "--dry-run")
    assert done.exit_code == (0 if first == "filter" else 2)
