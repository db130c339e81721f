"""gsedit style: a scene and a picture in, a scene out."""

from __future__ import annotations

import json

import numpy as np
from command_line import gsedit, one_line
from PIL import Image

from gsedit.formats.registry import open_scene, write_scene
from gsedit.formats.scenes import load
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.scene.table import table_of


def test_style_writes_a_scene_of_other_colors(scene, tmp_path):
    picture, out = tmp_path / "painting.png", tmp_path / "painted.ply"
    noise = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
    Image.fromarray(noise).save(picture)
    words = ("--steps", 2, "--views", 2, "--size", 32, "--up", "-y", "--json")
    done = gsedit("style", scene, picture, *words, "-o", out)
    assert done.exit_code == 0, done.stderr
    before, after = load(scene), load(out)
    assert len(after) == len(before)
    assert float((after.sh - before.sh).abs().max()) > 0.05
    record = json.loads(done.stdout.splitlines()[-1])
    stages = [each["stage"] for each in record["measures"]]
    assert stages == ["before", "colors", "texture"]


def test_a_wrong_request_is_one_line(scene, tmp_path):
    for words, message in (
        ((scene, tmp_path / "none.png", "-o", tmp_path / "a.ply"), "none.png cannot be read"),
        ((scene, scene, "-o", tmp_path / "a.obj"), "name a scene file"),
        ((scene, scene, "-o", tmp_path / "a.ply", "--strength", 3), "0 to 1"),
    ):
        done = gsedit("style", *words)
        assert done.exit_code in (2, 3)
        assert one_line(done.stderr)
        assert message in done.stderr


def test_columns_of_the_file_stay_and_too_much_sh_is_told(scene, tmp_path):
    picture, marked = tmp_path / "p.png", tmp_path / "marked.npz"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)).save(picture)
    table = table_of(load(scene))
    table = table.replace(extra={"label": np.arange(len(table), dtype=np.int32)})
    header = SceneHeader(table.degree, {"label": np.dtype(np.int32)}, antialiased=True)
    write_scene(marked, header, in_blocks(table))
    words = ("--steps", 0, "--views", 2, "--size", 32, "--up", "-y")
    for name in ("out.npz", "out.splat"):
        done = gsedit("style", marked, picture, *words, "-o", tmp_path / name)
        assert done.exit_code == 0, done.stderr
    assert "holds no SH" in done.stderr
    assert "holds no extra columns: label" in done.stderr
    kept = open_scene(tmp_path / "out.npz")
    assert "marked as antialiased: style draws it with the default filter" in done.stderr
    assert kept.header.antialiased
    assert kept.table().extra["label"].tolist() == list(range(len(table)))
