"""`gsedit edit --preview` and `--seeds`: a picture before anything is done."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import files, gsedit, one_line
from PIL import Image


def test_a_preview_is_one_picture_and_nothing_else(scene, photos, tmp_path):
    file = tmp_path / "out" / "look.png"
    file.parent.mkdir()
    region = tmp_path / "all.npy"
    np.save(region, np.ones(5, bool))
    words = ("paint it red", "--data", photos, "--region", region, "--size", 64)
    result = gsedit("edit", scene, *words, "--preview", "-o", file)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip().endswith("look.png")
    assert "understood as: " in result.stderr
    assert [path.name for path in files(file.parent)] == ["look.png"]
    with Image.open(file) as picture:
        assert picture.width > 1.7 * picture.height
    again = gsedit("edit", scene, *words, "--preview", "-o", file)
    assert again.exit_code == 2
    assert "exists" in again.stderr


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--preview", "-o", "out"), "name it as in -o out.png"),
        (("--seeds", 3), "one result"),
    ],
)
def test_what_no_preview_can_be_is_refused(scene, photos, tmp_path, monkeypatch, more, message):
    monkeypatch.chdir(tmp_path)
    result = gsedit("edit", scene, "paint it red", "--data", photos, *more)
    assert result.exit_code == 2
    assert message in result.stderr
    assert one_line(result.stderr)
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "preview.png").exists()


@pytest.mark.parametrize("more", [("-o", "out"), ("--preview", "-o", "out.png")])
def test_a_file_to_put_in_is_checked_before_the_scene_is_read(scene, tmp_path, monkeypatch, more):
    monkeypatch.chdir(tmp_path)
    scene.write_bytes(b"no scene")
    result = gsedit("edit", scene, "put nowhere.ply on the ground", *more)
    assert result.exit_code == 3
    assert "nowhere.ply" in result.stderr
    assert one_line(result.stderr)


def test_a_sentence_without_quotes_is_told_to_have_them(scene):
    result = gsedit("edit", scene, "remove", "the", "bear")
    assert result.exit_code == 2
    assert "put the whole sentence in quotes" in result.stderr
