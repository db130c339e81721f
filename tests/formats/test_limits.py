"""Bounds of what files may hold: rows, pictures, headers and meshes, and what is no file at all."""

import os
import subprocess
import sys
import time

import pytest
from bad_files import dataset
from PIL import Image
from splat_tables import random_table

from gsedit.errors import InputError
from gsedit.formats.files import open_scene
from gsedit.formats.pictures import picture_size
from gsedit.formats.validity import invalid_rows
from gsedit.run.json_files import read_json


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("means", 2e9),
        ("means", -1e30),
        ("sh", 1e5),
        ("sh", -1e30),
        ("log_scales", 21.0),
        ("quats", 1e10),
        ("quats", 1e30),
    ],
)
def test_a_row_beyond_any_scene_is_invalid_as_nan_is(field, value):
    table = random_table(9)
    getattr(table, field)[4, ..., -1] = value
    assert invalid_rows(table).nonzero()[0].tolist() == [4]


def test_a_small_file_of_a_large_picture_takes_no_memory(tmp_path):
    """In a process of its own, whose largest size is what was asked for."""
    dataset(tmp_path / "set")
    photo = tmp_path / "set" / "images" / "1.png"
    Image.new("1", (13000, 13000)).save(photo, optimize=True)
    assert photo.stat().st_size < 50_000
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    (tmp_path / "a.png").write_bytes(photo.read_bytes())
    code = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from gsedit.errors import InputError\n"
        "from gsedit.formats.files import open_scene\n"
        "from gsedit.formats.pictures import read_mask, read_photo\n"
        "folder = Path(sys.argv[1])\n"
        "import trimesh\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "photo = folder / 'set/images/1.png'\n"
        "for read in (read_photo, lambda p: read_mask(p, 8, 6),\n"
        "             lambda p: open_scene(folder / 'a.obj')):\n"
        "    try: read(photo)\n"
        "    except InputError as error: assert 'million are allowed' in str(error), error\n"
        "    else: raise AssertionError\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    assert int(done.stdout) * unit < 100e6


@pytest.mark.parametrize(
    "lines",
    [
        [f"element e{i} 0\nproperty float x" for i in range(20_000)],
        ["element vertex 1", *(f"property float c{i}" for i in range(30_000))],
    ],
    ids=["elements", "columns"],
)
def test_a_long_header_is_refused_at_once(tmp_path, lines):
    path = tmp_path / "a.ply"
    path.write_text("\n".join(["ply", "format ascii 1.0", *lines, "end_header", ""]))
    start = time.process_time()
    with pytest.raises(InputError, match="more than 100 elements, or 4096 columns"):
        open_scene(path)
    assert time.process_time() - start < 1


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1e200 0\nf 1 2 3\n"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -7\n"),
        ("a.obj", "mtllib ../a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("a.obj", "mtllib pipe.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    ],
)
def test_hostile_meshes_are_refused(tmp_path, name, content):
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (tmp_path / "in").mkdir()
    os.mkfifo(tmp_path / "in" / "pipe.mtl")
    (tmp_path / "in" / name).write_text(content)
    with pytest.raises(InputError, match=r"in/(a|pipe)\."):
        open_scene(tmp_path / "in" / name)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".spz", ".png", ".json"])
def test_what_is_no_file_is_refused_at_once(tmp_path, suffix):
    pipe = tmp_path / f"a{suffix}"
    os.mkfifo(pipe)
    reader = {".png": picture_size, ".json": read_json}.get(suffix, open_scene)
    with pytest.raises(InputError, match="a pipe or a device"):
        reader(pipe)
