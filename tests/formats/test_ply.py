"""Scene files: what is written is what is read, in whatever layout it comes."""

from __future__ import annotations

from dataclasses import fields

import gsply
import numpy as np
import pytest
import torch
from bad_files import PLY_COLUMNS, ply_bytes, scene_table
from splat_tables import random_table

from gsedit.errors import InputError
from gsedit.formats.files import open_scene
from gsedit.formats.ply.inria import columns
from gsedit.formats.ply.records import element_blocks, read_ply_header
from gsedit.formats.scenes import load, read_scene, save
from gsedit.scene.table import gaussians_of
from rasterizer import Gaussians


def assert_same(a: Gaussians, b: Gaussians) -> None:
    for field in fields(Gaussians):
        torch.testing.assert_close(getattr(a, field.name), getattr(b, field.name), rtol=0, atol=0)


def header(fmt: str, elements: str) -> bytes:
    return f"ply\nformat {fmt} 1.0\ncomment made by hand\n{elements}end_header\n".encode()


def properties(names, kind: str = "float") -> str:
    return "".join(f"property {kind} {name}\n" for name in names)


def as_ascii(table: np.ndarray) -> bytes:
    body = "\n".join(" ".join(repr(float(v)) for v in row) for row in table)
    start = f"element vertex {len(table)}\n" + properties(PLY_COLUMNS)
    return header("ascii", start) + body.encode()  # no newline at the end: legal, and common


def as_big_endian(table: np.ndarray) -> bytes:
    start = f"element vertex {len(table)}\n" + properties(PLY_COLUMNS)
    return header("binary_big_endian", start) + table.astype(">f4").tobytes()


def as_double(table: np.ndarray) -> bytes:
    start = f"element vertex {len(table)}\n" + properties(PLY_COLUMNS, "double")
    return header("binary_little_endian", start) + table.astype("<f8").tobytes()


def as_shuffled(table: np.ndarray) -> bytes:
    order = np.random.default_rng(1).permutation(len(PLY_COLUMNS))
    return ply_bytes(table[:, order], tuple(PLY_COLUMNS[i] for i in order))


def as_without_normals(table: np.ndarray) -> bytes:
    keep = [i for i, name in enumerate(PLY_COLUMNS) if not name.startswith("n")]
    return ply_bytes(table[:, keep], tuple(PLY_COLUMNS[i] for i in keep))


def as_crlf(table: np.ndarray) -> bytes:
    start, end, body = ply_bytes(table).partition(b"end_header\n")
    return (start + end).replace(b"\n", b"\r\n") + body


def as_crowded(table: np.ndarray) -> bytes:
    """An element in front, a byte column in front of each row, and an element of lists behind."""
    camera = "element camera 1\nproperty double focal\nproperty uchar kind\n"
    vertex = f"element vertex {len(table)}\nproperty uchar label\n" + properties(PLY_COLUMNS)
    face = "element face 1\nproperty list uchar int vertex_indices\n"
    rows = np.zeros(len(table), [("label", "u1"), ("rest", "<f4", len(PLY_COLUMNS))])
    rows["label"], rows["rest"] = 9, table
    first = np.array([(2.5, 3)], [("focal", "<f8"), ("kind", "u1")])
    faces = b"\x03" + np.arange(3, dtype="<i4").tobytes()
    start = header("binary_little_endian", camera + vertex + face)
    return start + first.tobytes() + rows.tobytes() + faces


LAYOUTS = [as_ascii, as_big_endian, as_double, as_shuffled, as_without_normals, as_crlf, as_crowded]


def vertices(path) -> np.ndarray:
    return next(element_blocks(path, read_ply_header(path), "vertex", 1 << 20))


@pytest.mark.parametrize("degree", range(4))
def test_others_read_what_we_write(degree, tmp_path):
    """gsply is the independent reader; INRIA's own expects exactly these columns."""
    scene = gaussians_of(random_table(7, degree))
    save(scene, tmp_path / "scene.ply")
    other = gsply.plyread(tmp_path / "scene.ply")
    sh = np.concatenate((other.sh0[:, None], other.shN.reshape(len(scene), -1, 3)), axis=1)
    np.testing.assert_array_equal(sh, scene.sh.numpy())
    np.testing.assert_array_equal(other.quats, scene.quats.numpy())
    vertex = vertices(tmp_path / "scene.ply")
    assert vertex.dtype.names == columns((degree + 1) ** 2)
    assert len(columns(16)) == 62


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda f: f.__name__)
def test_layout_does_not_matter(layout, tmp_path):
    table = scene_table()
    (tmp_path / "plain.ply").write_bytes(ply_bytes(table))
    (tmp_path / "other.ply").write_bytes(layout(table))
    assert_same(load(tmp_path / "other.ply"), load(tmp_path / "plain.ply"))


def test_everything_in_a_file_is_kept_or_named(tmp_path):
    path = tmp_path / "crowded.ply"
    path.write_bytes(as_crowded(scene_table()))
    source = open_scene(path)
    assert source.header.comments == ("made by hand",)
    assert source.header.elements["camera"]["focal"].tolist() == [2.5]
    assert source.table().extra["label"].tolist() == [9] * 5
    assert list(source.header.extra) == ["label", "nx", "ny", "nz"]
    assert list(source.header.elements) == ["camera"]
    assert source.notes == ("elements left out: face",)
    notes = " ".join(read_scene(path).notes)
    assert all(word in notes for word in ("label", "camera", "face"))


def test_cut_anywhere_is_an_error_not_a_crash(tmp_path):
    for layout in (ply_bytes, as_ascii, as_crowded):
        whole = layout(scene_table(2))
        for length in range(1, len(whole) - 20, 17):  # ASCII may lose its last digits unnoticed
            (tmp_path / "cut.ply").write_bytes(whole[:length])
            with pytest.raises(InputError):
                load(tmp_path / "cut.ply")


def test_drop_invalid_leaves_out_exactly_the_invalid_rows(tmp_path):
    table = scene_table(6)
    table[1, 0] = np.nan
    table[4, PLY_COLUMNS.index("rot_0") :] = 0
    (tmp_path / "scene.ply").write_bytes(ply_bytes(table))
    (tmp_path / "good.ply").write_bytes(ply_bytes(np.delete(table, [1, 4], axis=0)))
    file = read_scene(tmp_path / "scene.ply", drop_invalid=True)
    assert_same(file.scene, load(tmp_path / "good.ply"))
    assert "2 of 6" in file.notes[-1]


def test_splat_rows(tmp_path):
    row = np.zeros(1, [("p", "<f4", 3), ("s", "<f4", 3), ("c", "u1", 4), ("q", "u1", 4)])
    row["p"], row["s"], row["c"], row["q"] = (
        (1, 2, 3),
        (0.5, 1, 2),
        (255, 0, 0, 255),
        (255, 128, 128, 0),
    )
    (tmp_path / "a.splat").write_bytes(row.tobytes())
    scene = load(tmp_path / "a.splat")
    assert scene.means.tolist() == [[1, 2, 3]]
    torch.testing.assert_close(scene.scales, torch.tensor([[0.5, 1, 2]]))
    torch.testing.assert_close(scene.quats, torch.tensor([[127 / 128, 0, 0, -1]]))
    color = 0.5 + 0.28209479 * scene.sh[0, 0]
    torch.testing.assert_close(color, torch.tensor([1.0, 0, 0]), atol=1e-6, rtol=0)
    assert scene.logit_opacities.isfinite().all()
