"""`--region` from the shell: tinted pictures of it, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import files, gsedit
from PIL import Image


def test_a_region_is_tinted(scene, tmp_path):
    words = ["render", scene, "--count", 1, "--size", 24]
    plain, tinted = tmp_path / "plain", tmp_path / "tinted"
    assert gsedit(*words, "-o", plain).exit_code == 0
    result = gsedit(*words, "--region", "sphere:0,0,0,1e6", "-o", tinted)
    assert result.exit_code == 0, result.stderr
    assert "region: sphere:0,0,0,1e6; 5 of 5 Gaussians" in result.stderr
    (before,), (after,) = files(plain), files(tinted)
    assert not np.array_equal(np.asarray(Image.open(before)), np.asarray(Image.open(after)))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--region", "auto"], "add --prompt"),
        (["--prompt", "as gold"], "--prompt is for --region auto"),
        (["--region", "bear"], "give auto, all, box"),
        (["--region", "box:1,2,3"], "give 6 finite numbers"),
        (["--region", "sphere:1e7,0,0,1"], "holds no Gaussian"),
    ],
)
def test_regions_that_cannot_be_used_are_refused(scene, tmp_path, words, message):
    result = gsedit("render", scene, "--count", 1, "--size", 16, "-o", tmp_path / "out", *words)
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_region_of_another_scene_is_unreadable(scene, tmp_path):
    np.save(tmp_path / "flags.npy", np.ones(7, bool))
    words = ["--region", tmp_path / "flags.npy", "-o", tmp_path / "out"]
    result = gsedit("render", scene, "--count", 1, "--size", 16, *words)
    assert result.exit_code == 3
    assert "the scene has 5 Gaussians" in result.stderr


def test_an_edit_refuses_a_region_before_it_begins(scene, tmp_path):
    result = gsedit("edit", scene, "as gold", "--region", "here", "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert "give auto, all, box" in result.stderr
    assert not (tmp_path / "out").exists()
