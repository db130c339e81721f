"""PlayCanvas' .sog: read as gsply reads it, written within a byte's steps, refused when it lies."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from splat_tables import random_table

from gsedit.errors import InputError
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.sog.encode import lossless_webp
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.scene.table import SplatTable


def write(path: Path, table: SplatTable) -> Path:
    header = SceneHeader(table.degree, antialiased=True)
    write_scene(path, header, in_blocks(table, 70), overwrite=True)
    return path


def entries(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def changed(tmp_path: Path, change) -> Path:
    """A small scene whose meta.json and files `change` alters."""
    files = entries(write(tmp_path / "a.sog", random_table(50, 1)))
    meta = json.loads(files.pop("meta.json"))
    change(meta, files)
    with zipfile.ZipFile(tmp_path / "b.sog", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {"meta.json": json.dumps(meta), **files}.items():
            archive.writestr(name, data)
    return tmp_path / "b.sog"


def _name(meta, name: str) -> None:
    meta["scales"]["files"] = [name]


def _giant(meta, files) -> None:
    files["scales.webp"] = lossless_webp(np.zeros((4000, 4000, 4), np.uint8))


LIES = {
    "up": (lambda meta, files: _name(meta, "../../etc/passwd"), "leaves its folder"),
    "absolute": (lambda meta, files: _name(meta, "/etc/passwd"), "an absolute path"),
    "windows": (lambda meta, files: _name(meta, "C:\\x.webp"), "an absolute path"),
    "backslash": (lambda meta, files: _name(meta, "..\\x.webp"), "leaves its folder"),
    "missing": (lambda meta, files: _name(meta, "x.webp"), "has no x.webp"),
    "giant": (_giant, "4000x4000 pixels for 50"),
    "zip_bomb": (
        lambda _, files: files.update({"scales.webp": bytes(1 << 25)}),
        "larger than its scene explains",
    ),
    "absurd_count": (lambda meta, files: meta.update(count=1 << 31), "announces"),
    "larger_count": (lambda meta, files: meta.update(count=70), "pixels, the scene needs 70"),
    "not_a_count": (lambda meta, files: meta.update(count="50"), "count is '50'"),
    "no_picture": (lambda meta, files: files.update({"quats.webp": b"x" * 99}), "pixels"),
    "cut_picture": (
        lambda meta, files: files.update({"quats.webp": files["quats.webp"][:-30]}),
        "no readable picture",
    ),
    "infinite": (lambda meta, files: meta["means"].update(mins=[0, 1e999, 0]), "finite"),
    "codes": (lambda meta, files: meta["sh0"].update(codebook=[0.0] * 20), "beyond the end"),
    "version": (lambda meta, files: meta.update(version=3), "version 3"),
    "bands": (lambda meta, files: meta["shN"].update(bands=9), "bands is 9"),
    "labels": (lambda meta, files: meta["shN"].update(count=3), "SH entry"),
    "wide": (lambda meta, files: meta["shN"].update(bands=2), "pixels"),
    "list": (lambda meta, files: meta.update(means=[]), "means is no object"),
}  # fmt: skip


@pytest.mark.parametrize("lie", LIES)
def test_a_file_that_lies_is_refused(lie, tmp_path):
    change, words = LIES[lie]
    path = changed(tmp_path, change)
    with pytest.raises(InputError, match=words) as raised:
        open_scene(path).table()
    assert str(path) in str(raised.value)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    for name, data in entries(write(tmp_path / "a.sog", random_table(50, 1))).items():
        (folder / name).write_bytes(data)
    assert open_scene(folder).count == 50
    (tmp_path / "outside.webp").write_bytes((folder / "scales.webp").read_bytes())
    (folder / "scales.webp").unlink()
    (folder / "scales.webp").symlink_to(tmp_path / "outside.webp")
    with pytest.raises(InputError, match="leaves"):
        open_scene(folder).table()
