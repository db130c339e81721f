"""`gsedit info` and `gsedit render`: what is printed and which files are written."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import torch
from bad_files import ply_bytes, scene_table
from command_line import files, gsedit
from PIL import Image

from gsedit.formats.scenes import load


def test_info_tells_what_the_file_holds(scene):
    record = json.loads(gsedit("info", scene, "--json").stdout)
    means = load(scene).means
    assert record["gaussians"] == 5
    assert record["sh_degree"] == 1
    assert record["bytes"] == scene.stat().st_size
    assert [record[axis][0] for axis in "xyz"] == means.amin(0).tolist()
    assert [record[axis][-1] for axis in "xyz"] == means.amax(0).tolist()
    text = gsedit("info", scene)
    assert text.exit_code == 0
    assert text.stderr == ""
    assert len(text.stdout.splitlines()) <= 24  # one screen


def test_info_of_a_folder_of_sog_counts_its_files_only(scene, tmp_path):
    assert gsedit("convert", scene, tmp_path / "a.sog").exit_code == 0
    folder = tmp_path / "folder"
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        archive.extractall(folder)
    size = sum(each.stat().st_size for each in folder.iterdir())
    (folder / "inner").mkdir()
    (folder / "gone").symlink_to(tmp_path / "nothing")
    done = gsedit("info", folder, "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["bytes"] == size


def test_info_counts_invalid_rows_and_names_what_is_beside_the_splats(tmp_path):
    table = scene_table()
    table[1, 0] = float("nan")
    path = tmp_path / "holes.ply"
    start = b"ply\nformat binary_little_endian 1.0\ncomment mine"
    path.write_bytes(ply_bytes(table).replace(b"ply\nformat binary_little_endian 1.0", start, 1))
    record = json.loads(gsedit("info", path, "--json").stdout)
    assert (record["gaussians"], record["invalid"]) == (4, 1)
    assert record["comments"] == ["mine"]
    text = gsedit("info", path).stdout
    assert "row 1 (from 0): column x is nan" in text
    assert "mine" in text


def test_info_draws_histograms_and_keeps_files(scene, tmp_path):
    picture = tmp_path / "h.png"
    assert gsedit("info", scene, "--plot", picture).exit_code == 0
    assert Image.open(picture).size == (1200, 700)
    assert gsedit("info", scene, "--plot", picture).exit_code == 2


def test_info_and_convert_import_nothing_heavy(scene, tmp_path):
    heavy = "{'torch', 'scipy', 'numba', 'matplotlib', 'gsply', 'PIL', 'trimesh'}"
    code = (
        "import sys; from gsedit_cli.main import app\n"
        "try: app()\nexcept SystemExit as end: assert not end.code, end.code\n"
        f"assert not {heavy} & set(sys.modules), {heavy} & set(sys.modules)"
    )
    for words in (("info", scene), ("convert", scene, tmp_path / "a.compressed.ply")):
        arguments = [sys.executable, "-c", code, *map(str, words)]
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_render_writes_what_it_lists(scene, photos, tmp_path):
    out = tmp_path / "out"
    words = ["render", scene, "--data", photos, "--views", "0,2", "--depth", "-o", out, "--json"]
    result = gsedit(*words)
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    listed = {Path(line["picture"]) for line in lines if line["type"] == "result"}
    assert listed == set(files(out))
    ends = ("000_0.png", "000_0.depth.npy", "000_0.depth.png")
    assert {out / end for end in ends} < listed
    assert len(listed) == 6
    assert gsedit("render", scene, "--data", photos, "--views", "3", "-o", out, "-f").exit_code == 2


def test_render_places_cameras_where_there_are_none(scene, tmp_path):
    result = gsedit("render", scene, "--count", 2, "--size", 16, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    pictures = [tmp_path / "out" / f"view_{i:03d}.png" for i in range(2)]
    assert result.stdout.split() == [str(path) for path in pictures]
    assert set(files(tmp_path / "out")) == set(pictures)


def test_the_kernel_draws_the_same_pictures(scene, tmp_path):
    for kernel in ("auto", "torch"):
        out = tmp_path / kernel
        result = gsedit("render", scene, "--count", 1, "--size", 32, "-o", out, "--kernel", kernel)
        assert result.exit_code == 0, result.stderr
    a, b = (decode(tmp_path / kernel / "view_000.png") for kernel in ("auto", "torch"))
    assert (a - b).abs().max() <= 1  # rounding may fall to either side


def decode(path: Path) -> torch.Tensor:
    return torch.from_numpy(np.asarray(Image.open(path)).astype(int))


def test_core_commands_do_without_the_viewers(scene, tmp_path, monkeypatch):
    for name in ("open3d", "pyvista", "vtk"):
        monkeypatch.setitem(sys.modules, name, None)
    for words in (("info",), ("render", "--count", 1, "--size", 16, "-o", tmp_path / "out")):
        done = gsedit(words[0], scene, *words[1:])
        assert done.exit_code == 0, done.stderr
    assert (tmp_path / "out" / "view_000.png").exists()
