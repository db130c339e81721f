"""Damaged folders of nerfstudio and COLMAP, and meshes."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from bad_files import dataset
from PIL import Image

from hostile_cases.base import (
    LONG,
    NAMES,
    NUMBERS,
    Case,
    Record,
    Words,
    json_text,
)

FIT: Words = ["fit", "data", "--steps", 1, "--size", 16, "-o", "out/f.ply"]


def photos_with(change: Callable[[Record], Any]) -> Callable[[Path], Words]:
    """Make a folder of nine photos, whose record is changed, and fit it."""

    def make(arena: Path) -> Words:
        record = dataset(arena / "data", 9)
        for i, frame in enumerate(record["frames"]):
            frame["transform_matrix"][0][3] = i / 10
        changed = change(record)
        text = json_text(record if changed is None else changed)
        (arena / "data/transforms.json").write_text(
            text.replace("{absolute}", str(arena.parent / "escaped"))
        )
        return FIT

    return make


def photo_folders() -> Iterator[Case]:
    """Damage a folder of nerfstudio: numbers, paths, the text."""
    keys = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "p1", "camera_angle_x", "camera_model")
    for key in keys:
        for value in (*NUMBERS, None, "x", []):
            name = f"{key} {'long' if value == LONG else str(value)[:12]}"
            yield Case(
                "transforms.json", name, photos_with(lambda r, k=key, v=value: r.update({k: v}))
            )
    for value in (*NUMBERS, None, "x", []):

        def put(record: Record, value: Any = value) -> None:
            record["frames"][1]["transform_matrix"][0][3] = value

        name = f"pose {'long' if value == LONG else str(value)[:12]}"
        yield Case("transforms.json", name, photos_with(put))
    for name in NAMES:

        def rename(record: Record, name: str = name) -> None:
            record["frames"][1]["file_path"] = name

        yield Case("transforms.json", f"name {name[:20]!r}", photos_with(rename))
    for value in (None, 7, "x", [], {}, [None], [{}], [[]]):
        yield Case(
            "transforms.json", f"frames {value}", photos_with(lambda r, v=value: r.update(frames=v))
        )
        yield Case("transforms.json", f"whole {value}", photos_with(lambda _, v=value: v or [v]))
    yield Case("photos", "13000 x 13000 pixels", _bomb)
    for kind in ("text", "cut", "empty", "float"):
        yield Case("photos", kind, lambda a, k=kind: _bad_photo(a, k, FIT))


def _bad_photo(arena: Path, kind: str, words: Words) -> Words:
    dataset(arena / "data", 9)
    path = arena / "data/images/3.png"
    whole = path.read_bytes()
    path.write_bytes({"text": b"no picture", "cut": whole[:40], "empty": b""}.get(kind, whole))
    if kind == "float":
        Image.fromarray(np.full((6, 8), 0.5, np.float32)).save(path, format="TIFF")
    return words


def _bomb(arena: Path) -> Words:
    dataset(arena / "data", 9)
    Image.new("1", (13000, 13000)).save(arena / "data/images/3.png")
    return FIT


def colmap_folders() -> Iterator[Case]:
    """Damage a model of COLMAP, as text: its numbers and names."""
    words = FIT
    numbers = ("nan", "inf", "1e300", "-1", "0", "x", "", "9" * 40, "4611686018427387904")
    cells = {"cameras": (0, 1, 2, 3, 4, 5), "images": (0, 1, 5, 8, 9), "points3D": (0, 1, 4, 7)}
    for file, columns in cells.items():
        for column in columns:
            for value in numbers if column != 9 else NAMES[:14]:
                yield Case(
                    "COLMAP", f"{file} column {column} {value[:12]!r}",
                    lambda a, f=file, c=column, v=value: _colmap(a, f, c, v, words), apart="fork",
                )  # fmt: skip


def _colmap(arena: Path, file: str, column: int, value: str, words: Words) -> Words:
    from photo_sets import colmap_dataset

    folder = colmap_dataset(arena / "data", text=True)
    path = folder / f"sparse/0/{file}.txt"
    lines = path.read_text().splitlines()
    at = next((i for i, line in enumerate(lines) if line and line[0] != "#"), 0)
    parts = lines[at].split()
    if column < len(parts):
        parts[column] = value.replace("{absolute}", str(arena.parent / "escaped"))
    path.write_text("\n".join([*lines[:at], " ".join(parts), *lines[at + 1 :]]) + "\n")
    return words


def meshes() -> Iterator[Case]:
    """Write meshes with indices, positions and materials that are none."""
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    texts = {
        "index too high": f"{triangle}f 1 2 9\n", "index below": f"{triangle}f 1 2 -9\n",
        "index 2^40": f"{triangle}f 1 2 1099511627776\n", "index 0": f"{triangle}f 0 1 2\n",
        "vertices at 1e200": "v 1e200 0 0\nv 0 1e200 0\nv 0 0 1e200\nf 1 2 3\n",
        "vertices at 1e38": "v 1e38 0 0\nv 0 1e38 0\nv 0 0 1e38\nf 1 2 3\n",
        "nan": "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "empty": "", "points": triangle,
        "flat": f"{triangle}f 1 1 1\n", "binary": "\x00\x01\x02" * 50,
        "material outside": f"mtllib ../../../secret.mtl\n{triangle}f 1 2 3\n",
        "material absolute": f"mtllib /etc/passwd\n{triangle}f 1 2 3\n",
        "material is a device": f"mtllib /dev/zero\n{triangle}f 1 2 3\n",
        "material in a URL": f"mtllib http://localhost:1/a.mtl\n{triangle}f 1 2 3\n",
    }  # fmt: skip
    for name, text in texts.items():
        for verb in ("info", "convert"):
            end = ["out/c.ply"] if verb == "convert" else []
            yield Case("mesh", f"{name} {verb}",
                       lambda a, t=text, v=verb, e=end: _obj(a, t, [v, "m.obj", *e]))  # fmt: skip
    yield Case("mesh", "texture of 13000 x 13000", _texture)
    for picture in ("../../secret.png", "{absolute}.png", "/dev/zero", "link.png", "a\0b", ".."):
        yield Case("mesh", f"texture {picture!r}", lambda a, p=picture: _texture_of(a, p))
    yield Case("mesh", "material is a pipe", _pipe, apart="process")
    for name, faces in {"index": [3, 0, 1, 99], "negative": [3, 0, 1, -5]}.items():
        yield Case("mesh", f"ply {name}", lambda a, f=faces: _ply_mesh(a, f))


def _obj(arena: Path, text: str, words: Words) -> Words:
    (arena / "m.obj").write_text(text)
    return words


def _texture(arena: Path) -> Words:
    Image.new("1", (13000, 13000)).save(arena / "t.png")
    (arena / "m.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    return _obj(arena, f"mtllib m.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n", ["info", "m.obj"])


def _texture_of(arena: Path, name: str) -> Words:
    """Write a mesh whose texture has a name that leads outside, where a picture is."""
    for path in (arena.parents[1] / "secret.png", arena.parent / "escaped.png"):
        Image.new("RGB", (4, 4), "red").save(path)
    (arena / "link.png").symlink_to(arena.parents[1] / "secret.png")
    name = name.replace("{absolute}", str(arena.parent / "escaped"))
    (arena / "m.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    mesh = f"mtllib m.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n"
    return _obj(arena, mesh, ["convert", "m.obj", "out/c.ply"])


def _pipe(arena: Path) -> Words:
    os.mkfifo(arena / "m.mtl")
    return _obj(arena, "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ["info", "m.obj"])


def _ply_mesh(arena: Path, face: list[int]) -> Words:
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    body = np.eye(3, dtype="<f4").tobytes() + struct.pack("<Biii", *face)
    (arena / "m.ply").write_bytes(header.encode() + body)
    return ["info", "m.ply"]
