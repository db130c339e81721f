"""Files that the commands read."""

from __future__ import annotations

from pathlib import Path

import pytest
from bad_files import dataset, ply_bytes, scene_table


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
