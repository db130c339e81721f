"""Files that the commands read."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from bad_files import dataset, ply_bytes, scene_table

from gsedit.cameras.choose import find_views
from gsedit.cameras.search import SearchEffort


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    """Few places where a command searches for views: what is found is tested elsewhere."""
    few = SearchEffort(places=12, kept=4, rendered=6, varied=4)
    for module in ("gsedit.cameras.around", "gsedit.toolkit.differences"):
        monkeypatch.setattr(f"{module}.find_views", partial(find_views, effort=few))


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
