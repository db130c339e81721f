"""Inputs that cannot be read, one builder each; every reader and command must refuse them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from gsedit.formats.ply.inria import columns

PLY_COLUMNS = columns(4)  # SH degree 1: small, and every kind of column is there


class BadFile(NamedTuple):
    """A bad input, and what gsedit must say of it."""

    name: str
    build: Callable[[Path], Path]
    """Writes it below an empty folder and returns the path to pass to gsedit."""
    kind: str
    """ "scene" or "dataset": which reader it is for."""
    words: tuple[str, ...]
    """Texts that the one-line message must contain."""


def scene_table(rows: int = 5) -> np.ndarray:
    """Valid rows in the order of PLY_COLUMNS."""
    table = np.random.default_rng(0).normal(size=(rows, len(PLY_COLUMNS))).astype("<f4")
    table[:, PLY_COLUMNS.index("rot_0")] = 1
    return table


def ply_bytes(
    table: np.ndarray, names: tuple[str, ...] = PLY_COLUMNS, count: int | None = None
) -> bytes:
    """A float32 little-endian .ply of one vertex element, which may promise another count."""
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"element vertex {len(table) if count is None else count}"]
    lines += [f"property float {name}" for name in names] + ["end_header\n"]
    return "\n".join(lines).encode() + table.astype("<f4").tobytes()


def dataset(folder: Path, frames: int = 3, size: tuple[int, int] = (8, 6)) -> dict[str, Any]:
    """Write a valid nerfstudio dataset; returns its record, to be changed and written again."""
    (folder / "images").mkdir(parents=True)
    record: dict[str, Any] = {"w": size[0], "h": size[1], "fl_x": 9.0, "frames": []}
    for i in range(frames):
        pixels = np.full((size[1], size[0], 3), 40 * i % 256, np.uint8)
        Image.fromarray(pixels).save(folder / "images" / f"{i}.png")
        frame = {"file_path": f"images/{i}.png", "transform_matrix": np.eye(4).tolist()}
        record["frames"].append(frame)
    write(folder, record)
    return record


def write(folder: Path, record: Any) -> Path:
    """Write transforms.json; returns the folder."""
    (folder / "transforms.json").write_text(json.dumps(record))
    return folder


def _scene_file(content: bytes | Callable[[], bytes], name: str = "scene.ply"):
    def build(tmp: Path) -> Path:
        (tmp / name).write_bytes(content() if callable(content) else content)
        return tmp / name

    return build


def _spoiled_scene(column: str, value: float):
    def content() -> bytes:
        table = scene_table()
        table[3, PLY_COLUMNS.index(column)] = value
        return ply_bytes(table)

    return _scene_file(content)


def _zero_quaternion() -> bytes:
    table = scene_table()
    table[2, PLY_COLUMNS.index("rot_0") :] = 0
    return ply_bytes(table)


def _without(columns_left_out: tuple[str, ...]) -> Callable[[], bytes]:
    def content() -> bytes:
        keep = [i for i, name in enumerate(PLY_COLUMNS) if name not in columns_left_out]
        return ply_bytes(scene_table()[:, keep], tuple(PLY_COLUMNS[i] for i in keep))

    return content


def _ascii(body: str) -> bytes:
    header = "".join(f"property float {name}\n" for name in PLY_COLUMNS)
    return f"ply\nformat ascii 1.0\nelement vertex 2\n{header}end_header\n{body}".encode()


def _spoiled(spoil: Callable[[Path, dict[str, Any]], Any]):
    """A dataset that `spoil` (folder, record) changes on disk or in its record."""

    def build(tmp: Path) -> Path:
        folder = tmp / "set"
        record = dataset(folder)
        spoil(folder, record)
        return write(folder, record)

    return build


def _frame(**changes: Any):
    return _spoiled(lambda folder, record: record["frames"][1].update(changes))


def _text(text: str):
    def build(tmp: Path) -> Path:
        dataset(tmp / "set")
        (tmp / "set" / "transforms.json").write_text(text)
        return tmp / "set"

    return build


def _cut_photo(folder: Path, record: dict[str, Any]) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    photo = folder / "images" / "1.png"
    Image.fromarray(noise).save(photo)
    photo.write_bytes(photo.read_bytes()[:-40])


def _link_outside(folder: Path, record: dict[str, Any]) -> None:
    (folder.parent / "other.png").write_bytes((folder / "images" / "1.png").read_bytes())
    (folder / "images" / "1.png").unlink()
    (folder / "images" / "1.png").symlink_to(folder.parent / "other.png")


def _outside(folder: Path, record: dict[str, Any]) -> None:
    (folder.parent / "other.png").write_bytes((folder / "images" / "1.png").read_bytes())
    record["frames"][1]["file_path"] = "../other.png"


def _empty_folder(tmp: Path) -> Path:
    (tmp / "set").mkdir()
    return tmp / "set"


_SHEAR = [[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
_WHOLE = ply_bytes(scene_table())

_SCENES = {
    "missing": (lambda tmp: tmp / "scene.ply", "No such file"),
    "empty": (_scene_file(b""), "0 bytes"),
    "folder": (_empty_folder, "is a folder"),
    "unknown_suffix": (_scene_file(b"x", "scene.blend"), "reads .ply"),
    "no_ply": (_scene_file(b"\x00" * 99), "not a PLY"),
    "truncated": (_scene_file(_WHOLE[:-7]), "7 bytes more"),
    "cut_header": (_scene_file(_WHOLE[:200]), "end_header"),
    "promises_10^12": (_scene_file(ply_bytes(scene_table(), count=10**12)), "1000000000000 rows"),
    "promises_10^12_ascii": (
        _scene_file(_ascii("").replace(b"vertex 2", b"vertex 1000000000000")),
        "1000000000000 rows",
    ),
    "no_rows": (_scene_file(ply_bytes(scene_table(0))), "no Gaussians"),
    "ascii_ends_early": (_scene_file(_ascii("1 " * 90 + "\n")), "element vertex"),
    "ascii_word": (_scene_file(_ascii("word " * 60)), "vertex"),
    "zero_quaternion": (_scene_file(_zero_quaternion), "row 2"),
    "f_rest_missing": (_scene_file(_without(("f_rest_8",))), "8 f_rest"),
    "only_positions_and_rotations": (_scene_file(_without(PLY_COLUMNS[6:-4])), "opacity, scale_0"),
    "bad_obj": (_scene_file(b"f 1 2 3", "scene.obj"), "again"),
    "bad_stl": (_scene_file(b"solid x", "scene.stl"), "again"),
    "no_scales": (_scene_file(_without(("scale_1", "scale_2"))), "scale_1"),
    "bad_spz": (_scene_file(b"no spz", "scene.spz"), "not an SPZ"),
    "bad_splat": (_scene_file(b"x" * 33, "scene.splat"), "32-byte"),
} | {
    f"{value}_in_{column}": (_spoiled_scene(column, value), f"{column} is {value}")
    for column in PLY_COLUMNS
    if column not in ("nx", "ny", "nz")  # nobody reads normals: their values do no harm
    for value in (float("nan"), float("inf"), float("-inf"))
}


def _changed(**changes: Any):
    return _spoiled(lambda folder, record: record.update(changes))


def _lacking(key: str):
    return _spoiled(lambda folder, record: record.pop(key))


_DATASETS = {
    "no_dataset": (lambda tmp: tmp / "set", "does not exist"),
    "empty_folder": (_empty_folder, "transforms.json"),
    "empty_json": (_text(""), "0 bytes"),
    "bad_json": (_text('{"w": 8,\n "h" 6}'), "line 2, column 6"),
    "json_list": (_text("[]"), "no object"),
    "deep_json": (_text("[" * 10**5), "transforms.json"),
    "missing_photo": (_spoiled(lambda at, _: (at / "images" / "1.png").unlink()), "lists 3 photos"),
    "wrong_size": (_changed(w=16, h=9), "16x9"),
    "path_leaves": (_spoiled(_outside), "leaves the dataset"),
    "absolute_path": (_frame(file_path="/etc/hostname"), "leaves"),
    "long_name": (_frame(file_path="a" * 300), "is no name"),
    "link_leaves": (_spoiled(_link_outside), "leaves"),
    "zero_views": (_spoiled(lambda folder, record: record["frames"].clear()), "no views"),
    "no_frames": (_lacking("frames"), "no frames"),
    "no_file_path": (_frame(file_path=None), "frames[1] has no file_path"),
    "corrupt_photo": (_spoiled(_cut_photo), "1.png"),
    "photo_is_text": (
        _spoiled(lambda folder, _: (folder / "images" / "1.png").write_text("hello")),
        "no readable picture",
    ),
    "pose_3x3": (_frame(transform_matrix=[[1]]), "4x4"),
    "pose_nan": (_frame(transform_matrix=np.full((4, 4), np.nan).tolist()), "not finite"),
    "pose_shear": (_frame(transform_matrix=_SHEAR), "rigid"),
    "pose_mirror": (_frame(transform_matrix=np.diag([1, 1, -1, 1]).tolist()), "rigid"),
    "all_around": (_changed(camera_model="EQUIRECTANGULAR"), "EQUIRECTANGULAR"),
    "no_focal": (_lacking("fl_x"), "focal"),
    "focal_is_a_word": (_changed(fl_x="wide"), "fl_x is 'wide'"),
    "impossible_lens": (_changed(k1=-1e6), "calibrate again"),
    "missing_points": (_changed(ply_file_path="none.ply"), "none.ply"),
}

BAD_FILES = [
    BadFile(name, build, kind, (word,))
    for kind, table in (("scene", _SCENES), ("dataset", _DATASETS))
    for name, (build, word) in table.items()
]
