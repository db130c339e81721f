"""gsedit recolor: grading, palette and opacity in one verb, on a selection."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import gsedit, one_line
from PIL import Image

from gsedit.formats.scenes import load
from gsedit.scene.table import table_of
from gsedit.toolkit import recolor, select


def test_options_are_the_arguments_of_the_function(scene, tmp_path):
    out = tmp_path / "warm.ply"
    words = ("--exposure", "0.5", "--temperature", 8000, "--curve", "0.25:0.35", "--tint=-0.2")
    done = gsedit("recolor", scene, *words, "--where", "x > 0", "-o", out)
    assert done.exit_code == 0, done.stderr
    table = table_of(load(scene))
    expected = recolor(
        table, exposure=0.5, temperature=8000.0, tint=-0.2, curve=((0.25, 0.35),), where="x > 0"
    )
    np.testing.assert_allclose(table_of(load(out)).sh, expected.sh, atol=1e-5)
    assert np.abs(expected.sh - table.sh).max() > 0.05


def test_palette_and_opacity(scene, tmp_path):
    picture, out = tmp_path / "red.png", tmp_path / "red.ply"
    Image.new("RGB", (8, 8), (200, 30, 30)).save(picture)
    done = gsedit("recolor", scene, "--palette", picture, "--opacity-scale", "0.5", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "distance of the colors from those of red.png" in done.stderr
    before, after = load(scene), load(out)
    np.testing.assert_allclose(after.opacities, before.opacities / 2, atol=1e-5)
    colors = table_of(after).colors
    np.testing.assert_allclose(np.median(colors, 0), np.array([200, 30, 30]) / 255, atol=0.05)


def test_what_is_selected_is_decided_before_colors_change(scene, tmp_path):
    picture, out = tmp_path / "red.png", tmp_path / "out.ply"
    Image.new("RGB", (8, 8), (200, 30, 30)).save(picture)
    before = table_of(load(scene))
    inside = select(before, "luminance > 0.5")
    assert 0 < inside.sum() < len(inside)
    for more in ((), ("--palette", picture)):
        words = ("--exposure", -6, *more, "--opacity", 0.25, "--where", "luminance > 0.5")
        done = gsedit("recolor", scene, *words, "-o", out, "-f")
        assert done.exit_code == 0, done.stderr
        after = table_of(load(out))
        np.testing.assert_allclose(after.opacities[inside], 0.25, atol=1e-5)
        np.testing.assert_array_equal(after.sh[~inside], before.sh[~inside])
        np.testing.assert_array_equal(
            after.logit_opacities[~inside], before.logit_opacities[~inside]
        )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "recolor changes nothing"),
        (("--curve", "0.5;0.6"), "0:0.1,0.5:0.6"),
        (("--temperature", "10"), "kelvin, 1667"),
        (("--palette", "none.png"), "none.png cannot be read"),
        (("--exposure", "bright"), "--exposure"),
    ],
)
def test_a_wrong_request_is_one_line(scene, tmp_path, words, message):
    done = gsedit("recolor", scene, *words, "-o", tmp_path / "out.ply")
    assert done.exit_code in (2, 3)
    assert one_line(done.stderr)
    assert message in done.stderr
    assert not (tmp_path / "out.ply").exists()
