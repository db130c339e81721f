"""Names from foreign files lead to files inside a folder, or to an error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from gsedit import View
from gsedit.errors import InputError
from gsedit.run.inputs import picture_names, safe_name
from gsedit.views.cameras_json import read_cameras
from gsedit.views.view_list_files import read_view_list
from gsedit.views.view_pictures import write_view_pictures
from rasterizer import look_at

ENTRY = {
    "id": 0, "img_name": "b", "width": 40, "height": 30, "position": [1.0, 2.0, 3.0],
    "rotation": np.eye(3).tolist(), "fy": 25.0, "fx": 20.0,
}  # fmt: skip
PIECES = (
    "..", ".", "/", "\\", "\\\\", "C:", "c:/", "a", "b.jpg", "b.png", "", " ", ". ", "...", "\0",
    "\n", "\x1b[2J", "\u2028", "\ud800", "é", "x" * 200, "~", "file://", "NUL", "%2e%2e", "..png",
)  # fmt: skip


def hostile_names(count: int) -> list[str]:
    rng = np.random.default_rng(0)
    return ["".join(rng.choice(PIECES, size=rng.integers(1, 9))) for _ in range(count)]


def test_a_name_stays_in_its_folder_or_is_refused(tmp_path):
    folder = tmp_path / "targets"
    folder.mkdir()
    kept = []
    for name in hostile_names(5000):
        try:
            safe = safe_name(name, "views.json")
        except InputError:
            continue
        assert safe == safe_name(safe, "views.json")
        assert ".." not in safe.split("/")
        kept.append(safe)
    assert 500 < len(kept) < 4500
    files = [folder / name for name in picture_names(kept)]
    assert len({str(file).casefold() for file in files}) == len(kept)  # the same names too
    assert all(file.resolve().is_relative_to(folder) for file in files)
    assert all(len(part.encode()) <= 255 for file in files for part in file.parts)


@pytest.mark.parametrize(
    "name", ["../../evil", "/evil", "C:\\evil", "x/..\\..\\evil", "evil\0", "\n"]
)
def test_readers_and_writers_refuse_names_that_leave(name, tmp_path):
    (tmp_path / "cameras.json").write_text(json.dumps([{**ENTRY, "img_name": name}]))
    with pytest.raises(InputError, match=r"\[0\]"):
        read_cameras(tmp_path / "cameras.json")
    frame = {"file_path": name, "transform_matrix": np.eye(4).tolist(),
             **dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "w", "h"), 8)}  # fmt: skip
    (tmp_path / "views.json").write_text(json.dumps({"frames": [frame]}))
    with pytest.raises(InputError, match=r"frames\[0\]"):
        read_view_list(tmp_path / "views.json")
    camera = look_at(torch.ones(3), torch.zeros(3), torch.tensor([0.0, 0, 1]), 50.0, 8, 6)
    folder = tmp_path / "out" / "targets"
    with pytest.raises(InputError, match="correct or remove it"):
        write_view_pictures(folder, [View(name, camera, torch.zeros(6, 8, 3))])
    assert not list(Path(tmp_path).rglob("*.png"))


def test_a_link_in_the_folder_is_not_followed(tmp_path):
    (tmp_path / "targets").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "targets" / "sub").symlink_to(tmp_path / "elsewhere")
    camera = look_at(torch.ones(3), torch.zeros(3), torch.tensor([0.0, 0, 1]), 50.0, 8, 6)
    with pytest.raises(InputError, match="leaves"):
        write_view_pictures(tmp_path / "targets", [View("sub/a", camera, torch.zeros(6, 8, 3))])
    assert not list((tmp_path / "elsewhere").iterdir())
