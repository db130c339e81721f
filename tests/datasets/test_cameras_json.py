"""cameras.json: what INRIA's trainer writes is read, and what is written is what it writes."""

from __future__ import annotations

import json

import pytest
import torch

from gsedit.errors import InputError, UsageError
from gsedit.views.cameras_json import cameras_file, read_cameras, write_beside, write_cameras
from gsedit.views.viewpoints import Viewpoint
from rasterizer import look_at

# the camera stands at (1, 2, 3) and looks along the world's +x, the world's -z is down
ENTRY = {
    "id": 0, "img_name": "b", "width": 40, "height": 30, "position": [1.0, 2.0, 3.0],
    "rotation": [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], "fy": 25.0, "fx": 20.0,
}  # fmt: skip


def some_cameras(count: int = 3) -> tuple[Viewpoint, ...]:
    up = torch.tensor([0.1, 0.2, 1.0])
    eyes = torch.tensor([[2.0, 1.0, 0.5 * i] for i in range(count)])
    cameras = [look_at(eye, torch.zeros(3), up, 50.0, 48, 36) for eye in eyes]
    return tuple(Viewpoint(f"{i:03d}.jpg", camera) for i, camera in enumerate(cameras))


def test_the_convention_is_inrias(tmp_path):
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([ENTRY, {**ENTRY, "id": 1, "img_name": "a"}]))
    first, second = read_cameras(path)
    assert (first.name, second.name) == ("a", "b")  # held-out cameras come first in INRIA's files
    camera = second.camera
    assert camera.center.tolist() == [1, 2, 3]
    assert camera.forward.tolist() == [1, 0, 0]
    xy, depth = camera.project(torch.tensor([[6.0, 2.0, 2.0]]).double())  # ahead and below
    assert depth.tolist() == [5]
    assert xy.tolist() == [[20.0, 15.0 + 25 / 5]]


def test_written_cameras_are_read_again(tmp_path):
    written = some_cameras()
    write_cameras(written, tmp_path / "cameras.json")
    entry = json.loads((tmp_path / "cameras.json").read_text())[1]
    assert set(entry) == set(ENTRY)
    read = read_cameras(tmp_path / "cameras.json")
    for a, b in zip(read, written, strict=True):
        assert a.name == b.name
        assert torch.allclose(a.camera.world_to_camera, b.camera.world_to_camera, atol=1e-12)
        assert (a.camera.fx, a.camera.width, a.camera.height) == (b.camera.fx, 48, 36)


@pytest.mark.parametrize(
    "content",
    ["", "{}", "[]", "[1]", json.dumps([{**ENTRY, "rotation": [[1, 0, 0]] * 3}]),
     json.dumps([{**ENTRY, "position": [0, 0]}]), json.dumps([{**ENTRY, "fx": -1}]),
     json.dumps([{**ENTRY, "position": [0, 0, 1e400]}])],
)  # fmt: skip
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "cameras.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"cameras.json"):
        read_cameras(path)


def test_cameras_of_another_scene_in_the_folder_stay(tmp_path):
    bear, dog = tmp_path / "bear.ply", tmp_path / "dog.compressed.ply"
    assert write_beside(bear, some_cameras(3)) == tmp_path / "cameras.json"
    assert write_beside(bear, some_cameras(3)) == tmp_path / "cameras.json"  # fitted again
    assert write_beside(dog, some_cameras(2)) == tmp_path / "dog.cameras.json"
    with pytest.raises(UsageError, match=r"dog\.cameras\.json already exists"):
        write_beside(dog, some_cameras(3))
    assert write_beside(dog, some_cameras(3), overwrite=True) == tmp_path / "dog.cameras.json"
    assert cameras_file(bear) == tmp_path / "cameras.json"
    assert cameras_file(dog) == tmp_path / "dog.cameras.json"
