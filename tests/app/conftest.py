"""A tiny scene with its cameras, and a page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from shutil import copytree
from threading import enumerate as threads

import pytest
import torch
from pages import make_page

from gsedit.app.page import Page
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.formats.scenes import save
from gsedit.views.cameras_json import write_cameras
from gsedit.views.viewpoints import Viewpoint


@pytest.fixture(scope="module", autouse=True)
def ended(quick_saliency) -> Iterator[None]:
    """Wait for what closed tabs still prepare: the interpreter cannot end inside C++."""
    yield
    for each in threads():
        if each.name in ("prepare", "soon"):
            each.join(20)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """A folder with a scene of 600 Gaussians and its cameras."""
    folder = tmp_path_factory.mktemp("tiny")
    save(
        surface_gaussians(demo_scene(), 600, torch.Generator().manual_seed(0)), folder / "bear.ply"
    )
    cameras = ring_cameras(demo_scene(), 6, 48)
    views = [Viewpoint(f"{i}.png", camera) for i, camera in enumerate(cameras)]
    write_cameras(views, folder / "cameras.json")
    return folder


@pytest.fixture
def scene(tiny, tmp_path) -> Path:
    """The tiny scene in a folder of its own."""
    return Path(copytree(tiny, tmp_path / "scenes")) / "bear.ply"


@pytest.fixture
def page(tmp_path) -> Iterator[Page]:
    """A page that may reach the test's folder, and copies scenes for its commands."""
    made = make_page(tmp_path)
    yield made
    made.close()
