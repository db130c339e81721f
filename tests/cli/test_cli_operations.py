"""Verbs that change a scene: counted, chained with `then`, and nothing written unasked."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from command_line import gsedit, one_line

from gsedit.formats.scenes import load


def test_a_chain_does_its_verbs_in_order_and_writes_once(scene, tmp_path):
    out = tmp_path / "small.ply"
    done = gsedit(
        "convert", scene, "--sh-degree", 1, "then", "convert", "--sh-degree", 0, "-o", out
    )
    assert done.exit_code == 0, done.stderr
    assert done.stdout.strip() == str(out)
    assert load(out).degree == 0
    assert len(load(out)) == len(load(scene))


def test_dry_run_writes_nothing_and_counts(scene, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    for out in ((), ("-o", tmp_path / "out.ply")):
        done = gsedit("convert", scene, "--sh-degree", 0, *out, "--dry-run", "--json")
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["gaussians"] == len(load(scene))
        assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "-o"),
        (("then",), "nothing follows then: name one of"),
        (("then", "convrt"), "then convrt: name one of"),
        (("-o", "scene.obj"), "gsedit writes"),
        (("then", "convert", "--sh-degre", "1", "-o", "a.ply"), "--sh-degre"),
    ],
)
def test_a_wrong_chain_is_one_line_that_names_the_next_move(
    scene, tmp_path, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    done = gsedit("convert", scene, "--sh-degree", 0, *words)
    assert done.exit_code == 2
    assert one_line(done.stderr)
    assert message in done.stderr


def test_existing_files_are_kept_without_force(scene, tmp_path):
    out = tmp_path / "small.ply"
    out.write_text("mine")
    done = gsedit("convert", scene, "--sh-degree", 0, "-o", out)
    assert done.exit_code == 2
    assert "add -f" in done.stderr
    assert out.read_text() == "mine"
    assert gsedit("convert", scene, "--sh-degree", 0, "-o", out, "-f").exit_code == 0
    assert load(out).degree == 0


def test_invalid_rows_are_refused_with_their_place(tmp_path):
    from bad_files import PLY_COLUMNS, ply_bytes, scene_table

    table = scene_table()
    table[3, PLY_COLUMNS.index("y")] = float("nan")
    path, out = tmp_path / "bad.ply", tmp_path / "out.ply"
    path.write_bytes(ply_bytes(table))
    done = gsedit("convert", path, "--sh-degree", 0, "-o", out)
    assert done.exit_code == 3
    assert "row 3 (from 0): column y is nan" in done.stderr
    assert not list(tmp_path.glob("*out.ply"))
    done = gsedit("convert", path, "--sh-degree", 0, "--drop-invalid", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "1" in done.stderr
    assert len(load(out)) == 4


@pytest.mark.parametrize("suffix", [".splat", ".compressed.ply", ".spz", ".glb", ".sog"])
def test_invalid_rows_end_in_one_line(suffix, tmp_path, recwarn):
    from bad_files import PLY_COLUMNS, ply_bytes, scene_table

    table = scene_table()
    for row, name in enumerate(("x", "f_rest_2", "opacity", "scale_1", "rot_0")):
        table[row, PLY_COLUMNS.index(name)] = float("nan")
    path = tmp_path / "bad.ply"
    path.write_bytes(ply_bytes(table))
    done = gsedit("convert", path, tmp_path / f"out{suffix}")
    assert done.exit_code == 3
    assert "row 0 (from 0): column x is nan; " in done.stderr
    assert not list(recwarn)
    assert [each.name for each in tmp_path.iterdir()] == ["bad.ply"]


def test_two_places_for_one_scene_are_refused(scene, tmp_path):
    done = gsedit("convert", scene, tmp_path / "a.ply", "-o", tmp_path / "b.spz")
    assert done.exit_code == 2
    assert "two scenes to write" in done.stderr


@pytest.mark.parametrize("drop", [(), ("--drop-invalid",)])
def test_rows_that_an_operation_makes_invalid_are_refused(scene, tmp_path, drop):
    done = gsedit("transform", scene, "--scale", "1e39", *drop, "-o", tmp_path / "big.ply")
    assert done.exit_code == 2
    assert "became invalid on the way" in done.stderr
    assert not list(tmp_path.glob("*big.ply"))


def test_torch_is_not_loaded(scene, tmp_path):
    code = (
        "import sys; from gsedit_cli.main import app\n"
        "try: app()\nexcept SystemExit as end: assert not end.code, end.code\n"
        "assert not {'torch', 'scipy', 'numba'} & set(sys.modules)"
    )
    words = ["convert", str(scene), "--sh-degree", "0", "-o", str(tmp_path / "o.ply")]
    arguments = [sys.executable, "-c", code, *words]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_convert_writes_by_suffix_and_names_what_is_lost(scene, tmp_path):
    from gsedit.formats.registry import open_scene

    for words in (("a.splat",), ("-o", "b.npz"), ("d.compressed.ply",)):
        name = words[-1]
        done = gsedit("convert", scene, *words[:-1], tmp_path / name)
        assert done.exit_code == 0, done.stderr
        assert done.stdout.strip() == str(tmp_path / name)
        assert ("holds no SH" in done.stderr) == (name == "a.splat")
    assert open_scene(tmp_path / "b.npz").header.degree == 1
    out = tmp_path / "e.npz"
    done = gsedit("convert", tmp_path / "b.npz", "then", "convert", out, "--sh-degree", 0)
    assert done.exit_code == 0, done.stderr
    assert open_scene(out).header.degree == 0
    assert gsedit("convert", scene).exit_code == 2


def test_convert_brings_an_export_of_nerfstudio_back_into_the_frame_of_its_photos(scene, tmp_path):
    import numpy as np

    from gsedit.formats.registry import open_scene
    from gsedit.scene.similarity import Similarity

    turn = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    exported = tmp_path / "dataparser_transforms.json"
    move = np.array([1.0, 2, 3])  # nerfstudio: x' = scale (R x + t)
    record = {"transform": np.column_stack((turn, move)).tolist(), "scale": 0.5}
    exported.write_text(json.dumps(record))
    original = open_scene(scene).table()
    out, words = tmp_path / "back/splat.ply", ("--undo-dataparser", exported)
    assert gsedit("convert", scene, out, *words).exit_code == 0
    back = open_scene(out).table()
    expected = (original.means / 0.5 - move) @ turn
    np.testing.assert_allclose(back.means, expected, atol=1e-5)
    np.testing.assert_allclose(back.log_scales, original.log_scales + np.log(2), atol=1e-5)
    again = Similarity(turn, 0.5, 0.5 * move).table(back)
    np.testing.assert_allclose(again.sh, original.sh, atol=1e-5)
    for place in ((tmp_path / "beside.ply",), ("-o", tmp_path / "beside.ply")):
        done = gsedit("convert", scene, *place, *words)
        assert done.exit_code == 2
        assert "write it into another folder" in done.stderr
    exported.write_text("{}")
    done = gsedit("convert", scene, out, *words, "-f")
    assert done.exit_code == 3
    assert one_line(done.stderr)
    assert "dataparser_transforms.json" in done.stderr


def test_one_command_writes_one_scene(scene, tmp_path):
    a, b = tmp_path / "a.ply", tmp_path / "b.ply"
    done = gsedit("convert", scene, "-o", a, "then", "convert", "--order", "morton", "-o", b)
    assert done.exit_code == 2
    assert f"not {a} and {b}: give one -o" in done.stderr
    assert not list(tmp_path.glob("[ab].ply"))


def test_an_invalid_row_is_named_by_its_place_in_the_file(tmp_path):
    from bad_files import PLY_COLUMNS, ply_bytes, scene_table

    table = scene_table()
    table[:3, PLY_COLUMNS.index("x")] = -9
    table[3, PLY_COLUMNS.index("y")] = float("nan")
    table[3, PLY_COLUMNS.index("x")] = 1
    path, out = tmp_path / "bad.ply", tmp_path / "out.ply"
    path.write_bytes(ply_bytes(table))
    done = gsedit("filter", path, "--where", "x > -8", "-o", out)
    assert done.exit_code == 3
    assert "row 3 (from 0): column y is nan; 1 of 5 rows are invalid" in done.stderr
    path.write_bytes(ply_bytes(scene_table()))
    done = gsedit("transform", path, "--scale", "1e39", "-o", out)
    assert done.exit_code == 2
    assert "5 of 5 rows became invalid on the way" in done.stderr
    assert not out.exists()


def test_merge_reads_the_others_as_its_options_say(tmp_path):
    import numpy as np
    from bad_files import PLY_COLUMNS, ply_bytes, scene_table

    table = scene_table()
    good, bad, out = (tmp_path / f"{name}.ply" for name in ("good", "bad", "out"))
    good.write_bytes(ply_bytes(table))
    done = gsedit("convert", good, tmp_path / "other.spz", "--spz-frame", "rdf")
    assert done.exit_code == 0, done.stderr
    done = gsedit("merge", good, tmp_path / "other.spz", "--spz-frame", "rdf", "-o", out)
    assert done.exit_code == 0, done.stderr
    means = load(out).means.numpy()
    np.testing.assert_allclose(means[5:], means[:5], atol=1e-3)
    table[3, PLY_COLUMNS.index("y")] = float("nan")
    bad.write_bytes(ply_bytes(table))
    done = gsedit("merge", good, bad, "-o", out, "-f")
    assert done.exit_code == 3
    assert f"{bad}: row 3 (from 0)" in done.stderr
    done = gsedit("merge", good, bad, "--drop-invalid", "-o", out, "-f")
    assert done.exit_code == 0, done.stderr
    assert f"{bad}: invalid rows left out: 1" in done.stderr
    assert len(load(out)) == 9


def test_cameras_beside_the_scene_are_those_of_the_first_where_it_is(scene, photos, tmp_path):
    from gsedit import load_dataset
    from gsedit.datasets.cameras_json import write_cameras

    (tmp_path / "there").mkdir()
    other = tmp_path / "there" / "other.ply"
    other.write_bytes(scene.read_bytes())
    seen = ("then", "filter", "--where", "seen(pixels=0.001)", "--dry-run")
    write_cameras(load_dataset(photos).views, other.with_name("cameras.json"))
    for words in (("merge", scene, other), ("transform", other, "--scale", 2)):
        done = gsedit(*words, *seen)
        assert done.exit_code == 2
        assert "seen() needs cameras: add --data" in done.stderr
    assert gsedit("merge", other, scene, *seen).exit_code == 0
