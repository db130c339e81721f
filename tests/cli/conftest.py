"""Files that the commands read."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from bad_files import dataset, ply_bytes, scene_table
from photo_sets import opengl_camera_to_world
from PIL import Image
from playroom import playroom

from gsedit import save
from gsedit.views.cameras_json import write_cameras
from gsedit.views.viewpoints import Viewpoint
from rasterizer import render


@pytest.fixture(autouse=True)
def short_search(quick_search):
    """Commands that search for views find some soon: which is tested elsewhere."""


@pytest.fixture
def scene(tmp_path) -> Path:
    """A scene file of five random Gaussians."""
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes(scene_table()))
    return path


@pytest.fixture
def photos(tmp_path) -> Path:
    """A dataset of three photos of 8 x 6 pixels."""
    dataset(tmp_path / "photos")
    return tmp_path / "photos"


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Path:
    """Folder of a scene of some objects, its cameras and its photos; to be copied before writing.

    The photos are of 48 pixels.
    """
    folder, made = tmp_path_factory.mktemp("room"), playroom()
    save(made.scene, folder / "room.ply")
    views = [Viewpoint(f"view_{i}", camera) for i, camera in enumerate(made.cameras)]
    write_cameras(views, folder / "cameras.json")
    (folder / "photos/images").mkdir(parents=True)
    frames = []
    for view in views:
        camera = view.camera.resized(48, 48)
        levels = 255 * render(made.scene, camera).color.clamp(0, 1).numpy()
        photo = Image.fromarray(levels.round().astype(np.uint8))
        photo.save(folder / f"photos/images/{view.name}.png")
        pose = opengl_camera_to_world(camera)
        frames.append({"file_path": f"images/{view.name}.png", "transform_matrix": pose})
    record = {"w": 48, "h": 48, "fl_x": camera.fx, "fl_y": camera.fy, "frames": frames}
    (folder / "photos/transforms.json").write_text(json.dumps(record))
    return folder


@pytest.fixture
def place(room, tmp_path) -> Path:
    """A copy of the room's folder, to write into."""
    return Path(copytree(room, tmp_path / "room"))
