"""filter and select: the selections of --where and --region, and those that are refused."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from command_line import gsedit, one_line

from gsedit.formats.scenes import load


def counts(scene, *words) -> tuple[int, str]:
    """How many Gaussians `gsedit filter` would keep, and its messages."""
    done = gsedit("filter", scene, *words, "--dry-run", "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)["gaussians"], done.stderr


def test_filter_keeps_what_is_selected_and_says_how_many(scene, tmp_path):
    out = tmp_path / "out.ply"
    means = load(scene).means
    median = float(means[:, 0].median())
    done = gsedit("filter", scene, "--where", f"x >= {median}", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "filter: kept 3 of 5 (-40.0 %)" in done.stderr
    assert sorted(load(out).means[:, 0]) == sorted(means[means[:, 0] >= median][:, 0])


def test_a_selection_is_saved_and_read(scene, tmp_path):
    region, out = tmp_path / "region.npy", tmp_path / "out.ply"
    done = gsedit("select", scene, "--where", "largest(2, opacity)", "-o", region)
    assert done.exit_code == 0, done.stderr
    assert done.stdout.strip() == str(region)
    assert "select: 2 of 5 (40.0 %)" in done.stderr
    flags = np.load(region)
    assert flags.dtype == bool
    for words in (("--region", region), ("--where", f"flags('{region}')")):
        assert gsedit("filter", scene, *words, "-o", out, "-f").exit_code == 0
        np.testing.assert_array_equal(load(out).means, load(scene).means[flags])
    assert gsedit("select", scene, "--where", "all()", "-o", region).exit_code == 2
    asked = ("filter", "--where", f"grow(flags('{region}'), 1) or x > 9")
    order = ("convert", "--order", "morton")
    done = gsedit(order[0], scene, *order[1:], "then", *asked, "--dry-run")
    assert done.exit_code == 2
    assert one_line(done.stderr)
    assert f"{region} says which rows" in done.stderr
    assert "put --order after" in done.stderr
    assert gsedit(asked[0], scene, *asked[1:], "then", *order, "--dry-run").exit_code == 0


def test_a_region_of_masks_and_what_is_seen_use_the_cameras_beside_the_scene(scene, photos):
    from PIL import Image

    done = gsedit("filter", scene, "--where", "seen(pixels=1)", "--dry-run")
    assert done.exit_code == 2
    assert "seen() needs cameras: add --data" in done.stderr
    seen, _ = counts(scene, "--where", "seen(pixels=0.001)", "--data", photos)
    named = counts(scene, "--where", f"seen('{photos}', 0.001)")
    assert named[0] == seen
    assert 0 < seen <= 5
    name = sorted((photos / "images").iterdir())[0].stem
    mask = scene.with_name(f"{name}.png")
    Image.new("L", (8, 6), 255).save(mask)
    drawn, _ = counts(scene, "--region", mask, "--data", photos)
    assert drawn <= 5
    assert counts(scene, "--where", f"mask('{mask}')", "--data", photos)[0] == drawn
    from gsedit import load_dataset
    from gsedit.datasets.cameras_json import write_cameras

    write_cameras(load_dataset(photos).views, scene.with_name("cameras.json"))
    assert counts(scene, "--region", mask)[0] == drawn


def test_a_region_and_an_expression_are_an_intersection(scene):
    ball, both = "sphere(0,0,0,1.5)", ("--region", "sphere:0,0,0,1.5", "--where", "y >= 0")
    assert counts(scene, *both)[0] == counts(scene, "--where", f"{ball} and y >= 0")[0]
    assert counts(scene, "--region", "all")[0] == 5


def test_the_subject_is_an_expression_and_a_region(scene, monkeypatch):
    import torch

    from gsedit.select.region import Region

    def find_subject(gaussians, cameras, execution, *, with_carrier):
        return Region(torch.arange(len(gaussians)) < 2 + with_carrier, "the subject")

    monkeypatch.setattr("gsedit.select.finder.find_subject", find_subject)
    assert counts(scene, "--region", "auto")[0] == 2
    assert counts(scene, "--where", "not subject()")[0] == 3
    assert counts(scene, "--where", "subject(base=True)")[0] == 3


def test_where_the_scene_is_is_told_if_nothing_is_selected(scene):
    means = load(scene).means
    low, high = (", ".join(f"{x:.4g}" for x in end) for end in (means.amin(0), means.amax(0)))
    done = gsedit("filter", scene, "--where", "sphere(900,0,0,1)", "--dry-run")
    assert done.exit_code == 0
    assert f"nothing is selected; the centers are from ({low}) to ({high})" in done.stderr
    assert "filter: kept 0 of 5 (-100.0 %)" in done.stderr


def test_a_selection_follows_another_operation(scene, tmp_path):
    out = tmp_path / "out.ply"
    words = ("--where", "largest(3, opacity)", "then", "filter", "--where", "smallest(1, opacity)")
    done = gsedit("filter", scene, *words, "-o", out)
    assert done.exit_code == 0, done.stderr
    assert len(load(out)) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "--where EXPRESSION"),
        (("--where", "box(1,2,3)"), "write box("),
        (("--where", "sphere(0,0,0,-1)"), "radius -1"),
        (("--where", "opacty > 0.1"), "did you mean opacity?"),
        (("--where", "opacity > 0.1 and"), "--where"),
        (("--where", "largest(10)"), "write largest("),
        (("--where", "largest('x', opacity)"), "no amount"),
        (("--where", "near('brown')"), "#rrggbb"),
        (("--where", "opacity >= 2"), "would hold no Gaussians"),
        (("--where", "middle(0.5)"), "middle() needs cameras"),
        (("--where", "subjct()"), "did you mean subject?"),
        (("--region", "spere:1"), "region 'spere:1' is none"),
        (("--where", "inside('missing.obj')"), "missing.obj"),
    ],
)
def test_a_wrong_selection_is_one_line_and_nothing_is_written(scene, tmp_path, words, message):
    out = tmp_path / "out.ply"
    done = gsedit("filter", scene, *words, "-o", out)
    assert done.exit_code == (3 if "missing.obj" in message else 2)
    assert one_line(done.stderr.splitlines(keepends=True)[-1])
    assert message in done.stderr
    assert not list(tmp_path.glob("*out.ply"))


def test_neither_torch_nor_scipy_is_loaded(scene, tmp_path):
    region = tmp_path / "region.npy"
    np.save(region, np.ones(5, bool))
    code = (
        "import sys; from gsedit_cli.main import app\n"
        "try: app()\nexcept SystemExit as end: assert not end.code, end.code\n"
        "heavy = {'torch', 'scipy', 'numba', 'open3d', 'trimesh', 'PIL', 'matplotlib'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    words = ["filter", scene, "--region", region, "--where"]
    words += ["z < 99 and (opacity > 0 or near(#a08050, 10))", "-o", tmp_path / "out.ply"]
    arguments = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
