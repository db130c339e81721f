"""glTF's KHR_gaussian_splatting: as its specification says, in whatever layout."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from splat_tables import assert_near, random_table

from gsedit.errors import InputError
from gsedit.formats.axes import LUF, to_axes
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.gltf.file import EXTENSION
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.scene.quaternions import axis_rotation
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import SplatTable

EXACT = {"means": 1e-6, "angle": 1e-5, "log_scales": 1e-5, "opacities": 1e-6, "colors": 1e-6}


def parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk of a .glb."""
    raw = path.read_bytes()
    magic, version, length, text = struct.unpack_from("<4sIII", raw)
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    return json.loads(raw[20 : 20 + text]), raw[20 + text + 8 :]


def glb(path: Path, scene: dict[str, Any], data: bytes) -> Path:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    data += bytes(-len(data) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    path.write_bytes(head + chunks + struct.pack("<I4s", len(data), b"BIN\0") + data)
    return path


def write(path: Path, table: SplatTable) -> Path:
    write_scene(path, SceneHeader(table.degree), in_blocks(table, 70))
    return path


def written(tmp_path: Path, table: SplatTable) -> tuple[dict[str, Any], bytes]:
    return parts(write(tmp_path / "a.glb", table))


def by_hand(table: SplatTable, *, degree: int = 0, rotation: str = "<f4") -> tuple[dict, bytes]:
    """One interleaved view of float POSITION, SCALE and SH, with integers between."""
    stored = to_axes(table, LUF)
    largest = {"<f4": 1, "i1": 127, "<i2": 32767}[rotation]
    kinds = {"<f4": 5126, "i1": 5120, "<i2": 5122}
    row = np.dtype([("p", "<f4", 3), ("q", rotation, 4), ("s", "<f4", 3), ("o", "<u2"),
                    ("pad", "<u2"), ("c", "<f4", (len(stored.sh[0]), 3))])  # fmt: skip
    rows = np.zeros(len(table), row)
    rows["p"], rows["s"], rows["c"] = stored.means, stored.scales, stored.sh
    quats = np.roll(stored.quats, -1, 1)
    rows["q"] = quats if rotation == "<f4" else np.rint(quats * largest)
    rows["o"] = np.rint(stored.opacities * 65535)
    at = {name: row.fields[name][1] for name in row.names}
    names = [("POSITION", "p", 5126, "VEC3"), (f"{EXTENSION}:SCALE", "s", 5126, "VEC3"),
             (f"{EXTENSION}:ROTATION", "q", kinds[rotation], "VEC4"),
             (f"{EXTENSION}:OPACITY", "o", 5123, "SCALAR")]  # fmt: skip
    accessors = [
        {"bufferView": 0, "byteOffset": at[f], "componentType": kind, "type": shape,
         "count": len(table), "normalized": kind != 5126}
        for _, f, kind, shape in names
    ]  # fmt: skip
    attributes = {name: i for i, (name, *_) in enumerate(names)}
    index = 0
    for band in range(degree + 1):
        for n in range(2 * band + 1):
            attributes[f"{EXTENSION}:SH_DEGREE_{band}_COEF_{n}"] = len(accessors)
            accessor = {"byteOffset": at["c"] + 12 * index, "componentType": 5126, "type": "VEC3"}
            accessors.append({**accessor, "bufferView": 0, "count": len(table)})
            index += 1
    primitive = {"attributes": attributes, "mode": 0, "extensions": {EXTENSION: {
        "kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}}  # fmt: skip
    view = {"buffer": 0, "byteLength": rows.nbytes, "byteStride": row.itemsize}
    scene = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
             "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}],
             "buffers": [{"byteLength": rows.nbytes}], "bufferViews": [view],
             "accessors": accessors}  # fmt: skip
    return scene, rows.tobytes()


def test_what_is_written_follows_the_specification(tmp_path):
    table = random_table(degree=1)
    scene, data = written(tmp_path, table)
    assert scene["extensionsUsed"] == [EXTENSION]
    primitive = scene["meshes"][0]["primitives"][0]
    about = primitive["extensions"][EXTENSION]
    assert (primitive["mode"], about["kernel"]) == (0, "ellipse")
    assert about["colorSpace"] == "srgb_rec709_display"
    accessor = scene["accessors"][primitive["attributes"]["POSITION"]]
    upright = table.means * [-1, -1, 1]  # half a turn about z: +y is up
    np.testing.assert_allclose(accessor["min"], upright.min(0))
    np.testing.assert_allclose(accessor["max"], upright.max(0))

    def values(name: str) -> np.ndarray:
        view = scene["bufferViews"][
            scene["accessors"][primitive["attributes"][f"{EXTENSION}:{name}"]]["bufferView"]
        ]
        raw = data[view["byteOffset"] :][: view["byteLength"]]
        return np.frombuffer(raw, "<f4").reshape(len(table), -1)

    np.testing.assert_allclose(values("SCALE"), np.exp(table.log_scales), rtol=1e-5)
    np.testing.assert_allclose(values("OPACITY")[:, 0], table.opacities, rtol=1e-5)
    w, x, y, z = table.quats.T
    np.testing.assert_allclose(values("ROTATION"), np.stack((-x, -y, z, w), 1), atol=1e-6)
    # y, z, x of degree 1: those of y and x change sign
    np.testing.assert_allclose(values("SH_DEGREE_1_COEF_0"), -table.sh[:, 1])
    np.testing.assert_allclose(values("SH_DEGREE_1_COEF_1"), table.sh[:, 2])
    assert scene["buffers"][0]["byteLength"] == len(data)


@pytest.mark.parametrize(("rotation", "angle"), [("<f4", 1e-5), ("<i2", 2e-4), ("i1", 0.03)])
def test_interleaved_and_normalised_integers(rotation, angle, tmp_path):
    table = random_table(50, 2)
    path = glb(tmp_path / "a.glb", *by_hand(table, degree=2, rotation=rotation))
    bounds = {**EXACT, "angle": angle, "opacities": 1e-5}
    assert_near(open_scene(path).table(), table, **bounds, sh=1e-6)


def test_nodes_place_their_splats(tmp_path):
    """A turned, scaled and moved node: as the similarity in glTF's axes, SH too."""
    table = random_table(50, 2)
    scene, data = by_hand(table, degree=2)
    turn = axis_rotation(np.array([1.0, 2, 3]), 40.0)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = 2 * turn, (1, 2, 3)
    scene["nodes"] = [
        {"children": [1], "translation": [0, 0, 5]},
        {"mesh": 0, "matrix": matrix.T.ravel().tolist()},
    ]
    again = open_scene(glb(tmp_path / "a.glb", scene, data)).table()
    placed = Similarity(turn, 2.0, np.array([1.0, 2, 8])).table(to_axes(table, LUF))
    assert_near(to_axes(again, LUF), placed, **{**EXACT, "means": 1e-5, "opacities": 1e-5}, sh=1e-5)


LIES = {
    "count": (lambda s: s["accessors"][0].update(count=10**12), "promises 1000000000000 rows"),
    "other_count": (lambda s: s["accessors"][0].update(count=4), "have"),
    "offset": (lambda s: s["accessors"][0].update(byteOffset=-4), "no sensible number"),
    "stride": (lambda s: s["bufferViews"][0].update(byteStride=4), "byteStride"),
    "kind": (lambda s: s["accessors"][0].update(componentType=5130), "5130"),
    "view": (lambda s: s["accessors"][0].update(bufferView=9), r"bufferViews\[9\]"),
    "sparse": (lambda s: s["accessors"][0].update(sparse={}), "sparse"),
    "circle": (lambda s: s["nodes"][0].update(children=[0]), "circle"),
    "shear": (lambda s: s["nodes"][0].update(scale=[1, 2, 1]), "shears"),
    "rotation": (lambda s: s["nodes"][0].update(rotation=[0, 0, 0, 0]), "quaternion"),
    "no_rotation": (
        lambda s: s["meshes"][0]["primitives"][0]["attributes"].pop(f"{EXTENSION}:ROTATION"),
        "no attribute",
    ),
    "packed": (
        lambda s: s["meshes"][0]["primitives"][0]["extensions"][EXTENSION].update(
            extensions={"KHR_gaussian_splatting_compression_spz_2": {}}
        ),
        "compression_spz_2",
    ),
    "outside": (lambda s: s["buffers"][0].update(uri="../a.bin"), "another file"),
    "no_asset": (lambda s: s.pop("asset"), "no asset"),
}  # fmt: skip


@pytest.mark.parametrize("lie", LIES)
def test_a_file_that_lies_is_refused(lie, tmp_path):
    change, words = LIES[lie]
    scene, data = by_hand(random_table(5, 0))
    change(scene)
    path = glb(tmp_path / "a.glb", scene, data)
    with pytest.raises(InputError, match=words) as raised:
        open_scene(path).table()
    assert str(path) in str(raised.value)
