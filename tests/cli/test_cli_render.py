"""`gsedit render`: paths, maps, formats and wipes, and what is refused before any work."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from command_line import answer, files, gsedit, names
from PIL import Image
from videos import read_frames

from gsedit import orbit
from gsedit.formats.files import write_scene
from gsedit.formats.scenes import load
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.pictures import animations
from gsedit.scene.table import table_of
from gsedit.views.cameras_json import read_cameras, write_cameras
from gsedit.views.viewpoints import Viewpoint, same_size
from rasterizer import Numerics, render


@pytest.fixture
def shot(scene) -> Path:
    """The scene with the cameras of a circle beside it."""
    cameras = orbit(load(scene), 6, 32)
    views = [Viewpoint(f"shot{i}", camera) for i, camera in enumerate(cameras)]
    write_cameras(views, scene.with_name("cameras.json"))
    return scene


def test_an_mp4_has_even_sides(shot, tmp_path):
    pytest.importorskip("av")
    out = tmp_path / "turn.mp4"
    result = gsedit("render", shot, "--frames", 3, "--resolution", "33x25", "-o", out)
    assert result.exit_code == 0, result.stderr
    assert [frame.shape for frame in read_frames(out)] == [(24, 32, 3)] * 3


def test_single_pictures_in_every_format_agree(shot, tmp_path):
    words = ["render", shot, "--views", "2", "--size", 24]
    for name, more in (("a.png", []), ("a.npy", []), ("a.exr", ["--show", "color,alpha,depth"])):
        result = gsedit(*words, "-o", tmp_path / name, *more)
        assert result.exit_code == 0, result.stderr
        assert result.stdout == f"{tmp_path / name}\n"
    numbers = np.load(tmp_path / "a.npy")
    levels = np.asarray(Image.open(tmp_path / "a.png")).astype(float)
    assert np.ptp(levels) > 50  # the scene is in it
    np.testing.assert_allclose(levels, numbers.clip(0, 1) * 255, atol=0.51)
    import OpenEXR

    from gsedit.scene.color_space import srgb_of_linear

    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    assert set(channels) == set("RGBAZ")

    color = np.stack([channels[name] for name in "RGB"], -1)
    np.testing.assert_allclose(srgb_of_linear(color), numbers, atol=1e-5)


def test_an_antialiased_scene_is_rendered_as_it_was_trained(shot, tmp_path):
    marked = tmp_path / "marked.ply"
    table = table_of(load(shot))
    write_scene(marked, SceneHeader(table.degree, antialiased=True), in_blocks(table))
    result = gsedit("render", marked, "--views", "2", "--size", 24, "-o", tmp_path / "a.npy")
    assert result.exit_code == 0, result.stderr
    assert "marked.ply is marked as antialiased" in result.stderr
    viewpoint = same_size(read_cameras(shot.with_name("cameras.json")), 24)[2]
    expected = render(load(shot), viewpoint.camera, numerics=Numerics(antialiased=True)).color
    found = torch.from_numpy(np.load(tmp_path / "a.npy"))
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)
    assert (found - render(load(shot), viewpoint.camera).color).abs().max() > 1e-4
    result = gsedit("diff", shot, marked, "--size", 24, "--count", 1, "--json")
    assert 10 < json.loads(result.stdout.splitlines()[-1])["psnr"] < 90


def test_an_interrupted_animation_leaves_no_file(shot, tmp_path, monkeypatch):
    def broken(frames, *rest, **options):
        def stopping():
            yield next(iter(frames))
            raise KeyboardInterrupt

        animations_write(stopping(), *rest, **options)

    animations_write = animations.write_loop
    monkeypatch.setattr(animations, "write_loop", broken)
    before = set(files(tmp_path))
    result = gsedit("render", shot, "--frames", 3, "--size", 16, "-o", tmp_path / "a.gif")
    assert result.exit_code == 130
    assert set(files(tmp_path)) == before


def test_cameras_that_see_nothing_are_left_aside(shot, tmp_path):
    views = read_cameras(shot.with_name("cameras.json"))
    away = torch.eye(4, dtype=torch.float64)
    away[2, 3] = -1e6  # the scene is behind
    cameras = [replace(view.camera, world_to_camera=away) for view in views]
    elsewhere = [replace(view, camera=camera) for view, camera in zip(views, cameras)]
    write_cameras(elsewhere, shot.with_name("cameras.json"), overwrite=True)
    answer("render", shot, "--size", 16, "--count", 1, "-o", tmp_path / "out")
    assert names(tmp_path / "out") == {"view_000.png"}
