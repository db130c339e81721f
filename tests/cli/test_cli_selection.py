"""filter, crop and select: what their options select, and how they refuse."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from command_line import gsedit, one_line

from gsedit.files import load


def counts(scene, *words) -> tuple[int, str]:
    """How many Gaussians `gsedit filter` would keep, and its messages."""
    done = gsedit("filter", scene, *words, "--dry-run", "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)["gaussians"], done.stderr


def test_filter_keeps_what_is_selected_and_says_how_many(scene, tmp_path):
    out = tmp_path / "out.ply"
    means = load(scene).means
    median = float(means[:, 0].median())
    done = gsedit("filter", scene, "--box", f"{median},-,-,-,-,-", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "filter: kept 3 of 5 (-40.0 %)" in done.stderr
    assert sorted(load(out).means[:, 0]) == sorted(means[means[:, 0] >= median][:, 0])


def test_options_combine_with_and_and_where_says_the_same(scene):
    cases = [
        (("--box", "-1,-2,-3,1,2,3"), "box(-1,-2,-3,1,2,3)"),
        (("--box=-1,-2,-3,1,2,3",), "box(-1,-2,-3,1,2,3)"),
        (("--box", "-,-,-,0,-,-"), "x <= 0"),
        (("--oriented-box", "0,0,0,2,2,2,0,0,45"), "oriented_box(0,0,0,2,2,2,rz=45)"),
        (("--sphere", "-1,0,0,1"), "sphere(-1,0,0,1)"),
        (("--ellipsoid", "0,0,0,1,2,3"), "ellipsoid(0,0,0,1,2,3)"),
        (("--cylinder", "0,0,0,0,0,1,2"), "cylinder(0,0,0,0,0,1,2)"),
        (("--half-space", "0,0,0,-1,0,0"), "half_space(0,0,0,-1,0,0)"),
        (("--min-opacity", 0.5), "opacity >= 0.5"),
        (("--max-opacity", 0.5), "opacity <= 0.5"),
        (("--min-size", 1), "size >= 1"),
        (("--max-size", 1), "size <= 1"),
        (("--min-anisotropy", 4), "anisotropy >= 4"),
        (("--max-anisotropy", 4), "anisotropy <= 4"),
        (("--near-color", "#808080,50"), "near(#808080, 50)"),
        (("--near-color", "#888"), "near('888', 10)"),
        (("--largest", "2,opacity"), "largest(2, opacity)"),
        (("--smallest", "40%,distance(0,0,0)"), "smallest('40%', distance(0,0,0))"),
        (("--min-opacity", 0.3, "--max-size", 2), "opacity >= 0.3 and size <= 2"),
    ]
    for words, text in cases:
        assert counts(scene, *words)[0] == counts(scene, "--where", text)[0], words
        assert counts(scene, *words, "--invert")[0] == 5 - counts(scene, *words)[0]


def test_a_selection_is_saved_and_read(scene, tmp_path):
    region, out = tmp_path / "region.npy", tmp_path / "out.ply"
    done = gsedit("select", scene, "--largest", "2,opacity", "-o", region)
    assert done.exit_code == 0, done.stderr
    assert done.stdout.strip() == str(region)
    assert "select: 2 of 5 (40.0 %)" in done.stderr
    flags = np.load(region)
    assert flags.dtype == bool
    for words in (("--region", region), ("--where", f"flags('{region}')")):
        assert gsedit("filter", scene, *words, "-o", out, "-f").exit_code == 0
        np.testing.assert_array_equal(load(out).means, load(scene).means[flags])
    assert gsedit("select", scene, "--box", "-,-,-,-,-,-", "-o", region).exit_code == 2
    asked = ("filter", "--where", f"grow(flags('{region}'), 1) or x > 9")
    done = gsedit("order", scene, "then", *asked, "--dry-run")
    assert done.exit_code == 2
    assert one_line(done.stderr)
    assert f"{region} says which rows" in done.stderr
    assert "put order after" in done.stderr
    assert gsedit(asked[0], scene, *asked[1:], "then", "order", "--dry-run").exit_code == 0


def test_clusters_grown_and_shrunk(scene):
    cases = [
        (("--cluster", "largest", "--cluster-gap", 1.5), "cluster(gap=1.5)"),
        (("--cluster", "2"), "cluster(2)"),
        (("--cluster", "-1,0,0", "--cluster-gap", 1), "cluster_at(-1,0,0,1)"),
        (("--largest", "1,x", "--grow", 2), "grow(largest(1,x),2)"),
        (("--largest", "3,x", "--shrink", 1), "shrink(largest(3,x),1)"),
    ]
    for words, text in cases:
        assert counts(scene, *words)[0] == counts(scene, "--where", text)[0], words


def test_a_region_of_masks_and_what_is_seen_use_the_cameras_beside_the_scene(scene, photos):
    from PIL import Image

    done = gsedit("filter", scene, "--seen", 1, "--dry-run")
    assert done.exit_code == 2
    assert "--seen needs the cameras: add --data" in done.stderr
    seen, _ = counts(scene, "--seen", 0.001, "--data", photos)
    assert 0 < seen <= 5
    name = sorted((photos / "images").iterdir())[0].stem
    mask = scene.with_name(f"{name}.png")
    Image.new("L", (8, 6), 255).save(mask)
    drawn, _ = counts(scene, "--region", mask, "--data", photos)
    assert drawn <= 5
    from gsedit.files import load_dataset
    from gsedit.files.cameras import write_cameras

    write_cameras(load_dataset(photos).views, scene.with_name("cameras.json"))
    assert counts(scene, "--region", mask)[0] == drawn


def test_crop_keeps_the_inside(scene, tmp_path):
    words = ("--sphere", "0,0,0,1.5", "--half-space", "0,0,0,0,1,0")
    done = gsedit("crop", scene, *words, "--dry-run")
    assert done.exit_code == 0, done.stderr
    expected = counts(scene, *words)[0]
    assert f"crop: kept {expected} of 5" in done.stderr


def test_where_the_scene_is_is_told_if_nothing_is_selected(scene):
    means = load(scene).means
    low, high = (", ".join(f"{x:.4g}" for x in end) for end in (means.amin(0), means.amax(0)))
    done = gsedit("crop", scene, "--sphere", "900,0,0,1", "--dry-run")
    assert done.exit_code == 0
    assert f"nothing is selected; the centres are from ({low}) to ({high})" in done.stderr
    assert "crop: kept 0 of 5 (-100.0 %)" in done.stderr


def test_a_selection_follows_another_operation(scene, tmp_path):
    out = tmp_path / "out.ply"
    words = ("--largest", "3,opacity", "then", "filter", "--smallest", "1,opacity", "-o", out)
    done = gsedit("filter", scene, *words)
    assert done.exit_code == 0, done.stderr
    assert len(load(out)) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "add an option as --box"),
        (("--box", "1,2,3"), "--box 1,2,3: give 6 numbers separated by commas, or - for an open"),
        (("--sphere", "0,0,0,-1"), "radius -1"),
        (("--sphere", "0,0,0,-"), "give 4 numbers"),
        (("--where", "opacty > 0.1"), "did you mean opacity?"),
        (("--where", "opacity > 0.1 and"), "--where"),
        (("--largest", "10"), "1000,opacity"),
        (("--largest", "x,opacity"), "--largest 'x' is no amount"),
        (("--near-color", "brown"), "#rrggbb"),
        (("--min-opacity", "2"), "would hold no Gaussians"),
        (("--min-opacity", "nan"), "--min-opacity nan"),
        (("--cluster", "big"), "--cluster big: give largest, a number of clusters, or x,y,z"),
        (("--min-opacity", "0", "--cluster-gap", "1"), "--cluster-gap is for --cluster"),
        (("--region", "auto"), "--prompt"),
        (("--region", "spere:1"), "region 'spere:1' is none"),
        (("--inside", "missing.obj"), "missing.obj"),
    ],
)
def test_a_wrong_selection_is_one_line_and_nothing_is_written(scene, tmp_path, words, message):
    out = tmp_path / "out.ply"
    done = gsedit("filter", scene, *words, "-o", out)
    assert done.exit_code == (3 if "--inside" in words else 2)
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
    words = ["filter", scene, "--region", region, "--where", "opacity > 0 or near(#a08050, 10)"]
    words += ["--box", "-,-,-,-,-,99", "-o", tmp_path / "out.ply"]
    arguments = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
