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
    """Text that the one-line message must contain: the place and the next move."""


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

_SCENES = [
    BadFile("missing", lambda tmp: tmp / "scene.ply", "scene", ("No such file", "check the path")),
    BadFile("empty", _scene_file(b""), "scene", ("0 bytes", "export it again")),
    BadFile("folder", _empty_folder, "scene", ("is a folder", "name a file")),
    BadFile(
        "unknown_suffix", _scene_file(b"x", "scene.blend"), "scene", ("reads .ply", "name one")
    ),
    BadFile("no_ply", _scene_file(b"\x00" * 99), "scene", ("not a PLY", "check the path")),
    BadFile("truncated", _scene_file(_WHOLE[:-7]), "scene", ("7 bytes more", "cut off")),
    BadFile("cut_header", _scene_file(_WHOLE[:200]), "scene", ("end_header", "cut off")),
    BadFile(
        "promises_10^12",
        _scene_file(ply_bytes(scene_table(), count=10**12)),
        "scene",
        ("1000000000000 rows", "copy or export it again"),
    ),
    BadFile(
        "promises_10^12_ascii",
        _scene_file(_ascii("").replace(b"vertex 2", b"vertex 1000000000000")),
        "scene",
        ("1000000000000 rows", "copy or export it again"),
    ),
    BadFile("no_rows", _scene_file(ply_bytes(scene_table(0))), "scene", ("no Gaussians", "again")),
    BadFile(
        "ascii_ends_early",
        _scene_file(_ascii("1 " * 90 + "\n")),
        "scene",
        ("element vertex", "export it again"),
    ),
    BadFile("ascii_word", _scene_file(_ascii("word " * 60)), "scene", ("vertex", "again")),
    BadFile("zero_quaternion", _scene_file(_zero_quaternion), "scene", ("row 2", "--drop-invalid")),
    BadFile(
        "f_rest_missing", _scene_file(_without(("f_rest_8",))), "scene", ("8 f_rest", "needs 9")
    ),
    BadFile(
        "only_positions_and_rotations",
        _scene_file(_without(PLY_COLUMNS[6:-4])),
        "scene",
        ("opacity, scale_0", "export it again"),
    ),
    BadFile("bad_obj", _scene_file(b"f 1 2 3", "scene.obj"), "scene", ("again",)),
    BadFile("bad_stl", _scene_file(b"solid x", "scene.stl"), "scene", ("again",)),
    BadFile(
        "no_scales", _scene_file(_without(("scale_1", "scale_2"))), "scene", ("scale_1", "again")
    ),
    BadFile("bad_spz", _scene_file(b"no spz", "scene.spz"), "scene", ("not an SPZ", "again")),
    BadFile("bad_splat", _scene_file(b"x" * 33, "scene.splat"), "scene", ("32-byte", "again")),
    *(
        BadFile(
            f"{value}_in_{column}",
            _spoiled_scene(column, value),
            "scene",
            ("row 3", f"{column} is {value}", "1 of 5", "--drop-invalid"),
        )
        for column in PLY_COLUMNS
        if column not in ("nx", "ny", "nz")  # nobody reads normals: their values do no harm
        for value in (float("nan"), float("inf"), float("-inf"))
    ),
]
_DATASETS = [
    BadFile("no_dataset", lambda tmp: tmp / "set", "dataset", ("does not exist", "check the path")),
    BadFile("empty_folder", _empty_folder, "dataset", ("transforms.json", "check the path")),
    BadFile("empty_json", _text(""), "dataset", ("transforms.json", "0 bytes", "again")),
    BadFile("bad_json", _text('{"w": 8,\n "h" 6}'), "dataset", ("line 2, column 6", "repair")),
    BadFile("json_list", _text("[]"), "dataset", ("no object", "again")),
    BadFile("deep_json", _text("[" * 10**5), "dataset", ("transforms.json", "again")),
    BadFile(
        "missing_photo",
        _spoiled(lambda folder, record: (folder / "images" / "1.png").unlink()),
        "dataset",
        ("lists 3 photos", "images/1.png", "remove their entries"),
    ),
    BadFile(
        "wrong_size",
        _spoiled(lambda folder, record: record.update(w=16, h=9)),
        "dataset",
        ("8x6", "16x9", "use the photos"),
    ),
    BadFile(
        "path_leaves", _spoiled(_outside), "dataset", ("frames[1]", "leaves the dataset", "copy")
    ),
    BadFile(
        "absolute_path",
        _frame(file_path="/etc/hostname"),
        "dataset",
        ("frames[1]", "leaves", "copy"),
    ),
    BadFile(
        "long_name", _frame(file_path="a" * 300), "dataset", ("frames[1]", "is no name", "copy")
    ),
    BadFile("link_leaves", _spoiled(_link_outside), "dataset", ("frames[1]", "leaves", "copy")),
    BadFile(
        "zero_views",
        _spoiled(lambda folder, record: record["frames"].clear()),
        "dataset",
        ("no views", "check the dataset"),
    ),
    BadFile(
        "no_frames",
        _spoiled(lambda folder, record: record.pop("frames")),
        "dataset",
        ("no frames", "again"),
    ),
    BadFile(
        "no_file_path", _frame(file_path=None), "dataset", ("frames[1] has no file_path", "again")
    ),
    BadFile("corrupt_photo", _spoiled(_cut_photo), "dataset", ("1.png", "export it again")),
    BadFile(
        "photo_is_text",
        _spoiled(lambda folder, record: (folder / "images" / "1.png").write_text("hello")),
        "dataset",
        ("1.png", "no readable picture", "again"),
    ),
    BadFile(
        "pose_3x3",
        _frame(transform_matrix=[[1]]),
        "dataset",
        ("frames[1].transform_matrix", "4x4", "again"),
    ),
    BadFile(
        "pose_nan",
        _frame(transform_matrix=np.full((4, 4), np.nan).tolist()),
        "dataset",
        ("frames[1].transform_matrix", "not finite", "again"),
    ),
    BadFile(
        "pose_shear", _frame(transform_matrix=_SHEAR), "dataset", ("frames[1]", "rigid", "correct")
    ),
    BadFile(
        "pose_mirror",
        _frame(transform_matrix=np.diag([1, 1, -1, 1]).tolist()),
        "dataset",
        ("frames[1]", "rigid", "correct"),
    ),
    BadFile(
        "all_around",
        _spoiled(lambda folder, record: record.update(camera_model="EQUIRECTANGULAR")),
        "dataset",
        ("EQUIRECTANGULAR", "image_undistorter"),
    ),
    BadFile(
        "no_focal",
        _spoiled(lambda folder, record: record.pop("fl_x")),
        "dataset",
        ("focal", "add fl_x"),
    ),
    BadFile(
        "focal_is_a_word",
        _spoiled(lambda folder, record: record.update(fl_x="wide")),
        "dataset",
        ("fl_x is 'wide'", "repair it"),
    ),
    BadFile(
        "impossible_lens",
        _spoiled(lambda folder, record: record.update(k1=-1e6)),
        "dataset",
        ("-1e+06", "calibrate again"),
    ),
    BadFile(
        "missing_points",
        _spoiled(lambda folder, record: record.update(ply_file_path="none.ply")),
        "dataset",
        ("none.ply", "check the path"),
    ),
]

BAD_FILES = [*_SCENES, *_DATASETS]
