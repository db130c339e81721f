"""Files that the commands read."""

from __future__ import annotations

from pathlib import Path

import pytest
from bad_files import dataset, ply_bytes, scene_table

from gsedit.views import choose, search


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    """Few places where a command searches for views: what is found is tested elsewhere."""
    monkeypatch.setattr(search, "PLACES", 12)
    monkeypatch.setattr(search, "KEPT", 4)
    monkeypatch.setattr(choose, "RENDERED", 6)
    monkeypatch.setattr(choose, "VARIED", 4)


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
