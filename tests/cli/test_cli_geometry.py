"""Verbs that move, align, join and thin out scenes."""

from __future__ import annotations

import json
from math import ceil

import numpy as np
import pytest
from command_line import gsedit, one_line

from gsedit.datasets.cameras_json import own_file, read_cameras, write_cameras
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.formats.scenes import load
from gsedit.scene.quaternions import axis_rotation
from gsedit.select.saved import save_named
from rasterizer import Camera


def means(path) -> np.ndarray:
    return load(path).means.numpy()


def test_steps_stand_in_the_order_of_the_command_line(scene, tmp_path):
    a, b = tmp_path / "a.ply", tmp_path / "b.ply"
    move, scale = ("--translate", "-1,0,0"), ("--scale", "2")
    assert gsedit("transform", scene, *move, *scale, "-o", a).exit_code == 0
    assert gsedit("transform", scene, *scale, *move, "-o", b).exit_code == 0
    np.testing.assert_allclose(means(a), 2 * (means(scene) - [1, 0, 0]), atol=1e-5)
    np.testing.assert_allclose(means(b), 2 * means(scene) - [1, 0, 0], atol=1e-5)


def test_a_matrix_and_its_inverse_cancel(scene, tmp_path):
    matrix = np.eye(4)
    matrix[:3, :3] = 2 * axis_rotation(np.array([1.0, 2.0, 3.0]), 40.0)
    file, there, back = tmp_path / "m.txt", tmp_path / "a.ply", tmp_path / "b.ply"
    np.savetxt(file, matrix)
    assert gsedit("transform", scene, "--matrix", file, "-o", there).exit_code == 0
    assert gsedit("transform", there, "--matrix", file, "--inverse", "-o", back).exit_code == 0
    np.testing.assert_allclose(means(there), means(scene) @ matrix[:3, :3].T, atol=1e-5)
    np.testing.assert_allclose(means(back), means(scene), atol=1e-5)


def test_cameras_move_along(scene, tmp_path):
    import torch

    copy, out = tmp_path / "scene.ply", tmp_path / "moved.ply"
    copy.write_bytes(scene.read_bytes())
    pose = torch.eye(4, dtype=torch.float64)
    pose[2, 3] = 4.0  # the camera stands at z = -4
    camera = Camera(pose, 50.0, 50.0, 16.0, 16.0, 32, 32)
    write_cameras([Viewpoint("a.png", camera)], own_file(copy))
    arguments = ("--translate", "1,2,3", "--cameras", "-o", out)
    assert gsedit("transform", copy, *arguments).exit_code == 0
    done = gsedit("transform", copy, *arguments, "then", "transform", "--scale", "3")
    assert done.exit_code == 2  # exists
    done = gsedit("transform", copy, *arguments, "-f", "then", "transform", "--scale", "3")
    assert done.exit_code == 0, done.stderr
    assert f"cameras moved along: {own_file(out)}" in done.stderr
    (moved,) = read_cameras(own_file(out))
    np.testing.assert_allclose(moved.camera.center, [3, 6, -3])
    own_file(copy).unlink()
    done = gsedit("transform", copy, "--scale", "2", "--cameras", "-o", tmp_path / "b.ply")
    assert done.exit_code == 2
    assert "no cameras.json beside it" in done.stderr
    assert not (tmp_path / "b.ply").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "name what to do"),
        (("--translate", "1,2"), "--translate 1,2"),
        (("--scale", "two"), "--scale two"),
        (("--scale", "2", "--scale", "3"), "chain the second with then"),
        (("--mirror", "w"), "x, y and z are possible"),
        (("--up", "z"), "as in z,-y"),
        (("--pivot", "middle", "--scale", "2"), "--pivot middle"),
        (("--matrix", "none.txt"), "none.txt"),
    ],
)
def test_wrong_transforms_are_one_line(scene, tmp_path, words, message):
    done = gsedit("transform", scene, *words, "-o", tmp_path / "out.ply")
    assert done.exit_code in (2, 3)
    assert one_line(done.stderr)
    assert message in done.stderr


def test_a_selected_part_moves(scene, tmp_path):
    out = tmp_path / "out.ply"
    done = gsedit("transform", scene, "--translate", "0,9,0", "--where", "x < 0", "-o", out)
    assert done.exit_code == 0, done.stderr
    before = means(scene)
    lift = 9.0 * (before[:, :1] < 0) * [0, 1, 0]
    np.testing.assert_allclose(means(out), before + lift, atol=1e-5)


def test_center_says_where_the_center_was(scene):
    done = gsedit("transform", scene, "--center", "--dry-run", "--json")
    assert done.exit_code == 0, done.stderr
    assert "center at" in done.stderr
    assert json.loads(done.stdout)["output"] is None


def test_merge_decimate_and_order_in_one_chain(scene, tmp_path):
    out, count = tmp_path / "out.ply", len(load(scene))
    done = gsedit(
        *("merge", scene, scene, "-o", out, "then", "decimate", "50%"),
        *("then", "convert", "--order", "morton", "--json"),
    )
    assert done.exit_code == 0, done.stderr
    assert len(load(out)) == count
    assert f"decimate: kept {count:,} of {2 * count:,} (-50.0 %)" in done.stderr
    assert "dB (PSNR against those before)" in done.stderr
    quiet = gsedit("decimate", scene, "1", "--no-measure", "--dry-run")
    assert "dB" not in quiet.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("decimate", "half"), "give a share, as 50%"),
        (("decimate", "0"), "keep at least 1"),
        (("convert", "--order", "size"), "morton and importance"),
        (("merge", "none.ply"), "none.ply"),
        (("merge",), "OTHER"),
    ],
)
def test_wrong_words_are_one_line(scene, tmp_path, words, message):
    verb, *rest = words
    done = gsedit(verb, scene, *rest, "-o", tmp_path / "out.ply")
    assert done.exit_code in (2, 3)
    assert one_line(done.stderr)
    assert message in done.stderr


def test_a_known_length_is_saved_as_a_similarity(scene, tmp_path):
    out, file = tmp_path / "out.ply", tmp_path / "found.json"
    words = ("align", scene, "--length", "0,0,0,0,0,2=5", "--save", file)
    assert gsedit(*words, "--dry-run").exit_code == 0
    assert not file.exists()
    done = gsedit(*words, "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "scaled by 2.5" in done.stderr
    np.testing.assert_allclose(means(out), 2.5 * means(scene), atol=1e-5)
    again = tmp_path / "again.ply"
    assert gsedit("transform", scene, "--matrix", file, "-o", again).exit_code == 0
    np.testing.assert_allclose(means(again), means(out), atol=1e-5)
    assert gsedit(*words, "-o", tmp_path / "b.ply").exit_code == 2  # found.json exists


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give one of --to-ground, --to, --length"),
        (("--to-ground", "--length", "0,0,0,1,1,1=2"), "--to-ground and --length"),
        (("--length", "1,2=3"), "--length 1,2"),
        (("--to", "none.ply"), "none.ply"),
        (("--to-ground", "--up", "w"), "axis w"),
        (("--to-ground", "--save", "a.txt"), "name a .json file"),
    ],
)
def test_wrong_alignments_are_one_line(scene, tmp_path, words, message):
    done = gsedit("align", scene, *words, "-o", tmp_path / "out.ply")
    assert done.exit_code in (2, 3)
    assert one_line(done.stderr)
    assert message in done.stderr


def test_levels_of_detail(scene, tmp_path):
    out, count = tmp_path / "levels", len(load(scene))
    done = gsedit("decimate", scene, "50%", "--levels", 3, "--format", "spz", "-o", out, "--json")
    assert done.exit_code == 0, done.stderr
    name = scene.name.split(".")[0]
    files = [out / f"{name}_lod{level}.spz" for level in range(3)]
    counts = [len(load(file)) for file in files]
    assert counts == [count, ceil(count / 2), ceil(ceil(count / 2) / 2)]
    levels = json.loads((out / "lod.json").read_text())["levels"]
    assert [level["gaussians"] for level in levels] == counts
    assert levels[1]["psnr"] >= levels[2]["psnr"]
    levels = ("--levels", 2, "-o")
    assert gsedit("decimate", scene, "50%", *levels, out).exit_code == 2  # has files
    for words in (("1000",), ("50%", "--method", "random"), ("50%", "--format", "jpg")):
        assert gsedit("decimate", scene, *words, *levels, tmp_path / "b").exit_code == 2
    follows = ("then", "convert", "-o", tmp_path / "b")
    assert gsedit("decimate", scene, "50%", "--levels", 2, *follows).exit_code == 2
    assert not (tmp_path / "b").exists()


def test_levels_may_be_one_streamed_scene(scene, tmp_path):
    out, words = tmp_path / "lod", ("--levels", 2, "--format", "streamed", "--no-measure")
    done = gsedit("decimate", scene, "50%", *words, "-o", out, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads((out / "lod-meta.json").read_text())["counts"][0] == len(load(scene))
    assert gsedit("convert", out, "-o", tmp_path / "a.ply").exit_code == 0
    assert len(load(tmp_path / "a.ply")) == len(load(scene))
    assert gsedit("info", out).exit_code == 0
    assert gsedit("decimate", scene, "50%", *words, "-o", out).exit_code == 2  # has files


def test_levels_have_the_name_of_the_scene(scene, tmp_path):
    odd = scene.rename(tmp_path / "my.scan_lod0.v2.ply")
    out = tmp_path / "levels"
    done = gsedit("decimate", odd, "50%", "--levels", "2", "--no-measure", "-o", out)
    assert done.exit_code == 0, done.stderr
    names = {each.name for each in out.iterdir()}
    assert names == {f"my.scan_lod0.v2_lod{level}.ply" for level in (0, 1)} | {"lod.json"}


def test_bend_takes_pixels_and_points_and_moves_nothing_out_of_the_cage(scene, tmp_path):
    x, y, z = means(scene)[0].tolist()
    place, cage = f"{x},{y},{z}", f"sphere:{x},{y},{z},0.4"
    out = tmp_path / "bent.ply"
    done = gsedit("bend", scene, "--handle", f"{place}:0,0,0.05", "--cage", cage, "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "Gaussians were moved" in done.stderr
    moved = np.abs(means(out) - means(scene)).max(1) > 0
    near = np.linalg.norm(means(scene) - [x, y, z], axis=1) <= 0.4 + 1e-6
    assert moved.any()
    assert not (moved & ~near).any()


def test_a_saved_name_is_a_cage_and_the_place_of_a_handle(scene, tmp_path):
    inside = np.arange(len(means(scene))) < 3
    save_named(inside, means(scene), scene, "Left leg")
    x, y, z = means(scene)[inside].astype(float).mean(0)
    out, other = tmp_path / "bent.ply", tmp_path / "other.ply"
    named = ("--handle", "left_leg:0,0,0.05:0.5", "--hold", "left leg:0", "--cage", "the left leg")
    assert gsedit("bend", scene, *named[:2], *named[4:], "-o", out).exit_code == 0
    moved = np.abs(means(out) - means(scene)).max(1) > 0
    assert not moved[~inside].any()
    exact = ("--handle", f"{x},{y},{z}:0,0,0.05:0.5", *named[4:])
    assert gsedit("bend", scene, *exact, "-o", other).exit_code == 0
    assert (means(out) == means(other)).all()
    contradicting = gsedit("bend", scene, *named, "-o", tmp_path / "none.ply")
    assert contradicting.exit_code == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "name what to move"),
        (("--handle", "1,2,3"), "give VIEW:X,Y:DX,DY,DZ"),
        (("--handle", "1,2,3:0,0"), "3 finite numbers"),
        (("--handle", "1,2,3:0,0,1:-1"), "less than 0"),
        (("--handle", "90,90,90:0,0,1"), "from what is inside"),
        (("--handle", "none:1,2:0,0,1"), "a pixel of a view needs cameras"),
    ],
)
def test_handles_that_cannot_be_read_are_told_in_one_line(words, message, scene, tmp_path):
    done = gsedit("bend", scene, *words, "-o", tmp_path / "bent.ply")
    assert done.exit_code == 2
    assert one_line(done.stderr)
    assert message in done.stderr
    assert not (tmp_path / "bent.ply").exists()
