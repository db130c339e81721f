"""`gsedit render`: paths, maps, formats and wipes, and what is refused before any work."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from command_line import files, gsedit, one_line
from exr_files import read_exr
from PIL import Image
from videos import read_frames

from gsedit import orbit
from gsedit.cameras import around
from gsedit.datasets.cameras_json import read_cameras, write_cameras
from gsedit.datasets.viewpoints import Viewpoint, same_size
from gsedit.formats.registry import write_scene
from gsedit.formats.scenes import load
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.pictures import animations
from gsedit.scene.table import table_of
from rasterizer import Numerics, render


@pytest.fixture
def shot(scene) -> Path:
    """The scene with the cameras of a circle beside it."""
    cameras = orbit(load(scene), 6, 32)
    views = [Viewpoint(f"shot{i}", camera) for i, camera in enumerate(cameras)]
    write_cameras(views, scene.with_name("cameras.json"))
    return scene


@pytest.mark.parametrize("path", ["turntable", "orbit", "spline"])
def test_a_path_is_a_folder_of_frames(shot, tmp_path, path):
    out = tmp_path / "out"
    result = gsedit("render", shot, "--path", path, "--frames", 3, "--size", 24, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert sorted(p.name for p in files(out)) == [f"frame_{i:04d}.png" for i in range(3)]


def test_an_animation_is_one_file_of_that_many_frames(shot, tmp_path):
    out = tmp_path / "turn.gif"
    words = ["render", shot, "--frames", 3, "--resolution", "31x23", "--show", "color,depth"]
    result = gsedit(*words, "--fps", 10, "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout.splitlines()[-1])
    assert (record["frames"], record["bytes"]) == (3, out.stat().st_size)
    with Image.open(out) as picture:
        assert (picture.size, picture.n_frames) == ((62, 23), 3)


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
    channels = read_exr(tmp_path / "a.exr")
    assert set(channels) == set("RGBAZ")
    from gsedit.scene.color_space import srgb_of_linear

    color = np.stack([channels[name] for name in "RGB"], -1)
    np.testing.assert_allclose(srgb_of_linear(color), numbers, atol=1e-5)


def test_a_folder_in_numbers(shot, tmp_path):
    out = tmp_path / "out"
    words = ["--format", "npy", "--show", "normals,alpha", "--views", "1"]
    assert gsedit("render", shot, "--size", 24, *words, "-o", out).exit_code == 0
    assert sorted(p.name for p in files(out)) == ["001_shot1.alpha.npy", "001_shot1.normals.npy"]
    assert np.load(out / "001_shot1.normals.npy").shape == (24, 24, 3)


def test_a_background_is_behind_and_transparency_is_alpha(shot, tmp_path):
    words = ["render", shot, "--views", "0", "--size", 24, "--zoom", "0.3"]
    for name in ("red", "transparent"):
        result = gsedit(*words, "--background", name, "-o", tmp_path / f"{name}.png")
        assert result.exit_code == 0, result.stderr
    assert np.asarray(Image.open(tmp_path / "red.png"))[0, 0].tolist() == [255, 0, 0]
    clear = np.asarray(Image.open(tmp_path / "transparent.png"))
    assert clear.shape == (24, 24, 4)
    assert clear[0, 0, 3] == 0
    assert clear[..., 3].max() > 0


def test_a_wipe_shows_both(shot, tmp_path):
    other = tmp_path / "other.ply"
    other.write_bytes(shot.read_bytes())
    words = ["render", shot, "--wipe", other, "--size", 24]
    for out in ("wipe.png", "wipe.gif", "wipes"):
        more = ["--frames", 4] if out == "wipe.gif" else []
        result = gsedit(*words, *more, "-o", tmp_path / out)
        assert result.exit_code == 0, result.stderr
    still = np.asarray(Image.open(tmp_path / "wipe.png"))
    assert (still[:, 11:13] == 255).all()
    assert len(files(tmp_path / "wipes")) == 6


def test_an_antialiased_scene_is_rendered_as_it_was_trained(shot, tmp_path):
    marked = tmp_path / "marked.npz"
    table = table_of(load(shot))
    write_scene(marked, SceneHeader(table.degree, antialiased=True), in_blocks(table))
    result = gsedit("render", marked, "--views", "2", "--size", 24, "-o", tmp_path / "a.npy")
    assert result.exit_code == 0, result.stderr
    assert "marked.npz is marked as antialiased" in result.stderr
    viewpoint = same_size(read_cameras(shot.with_name("cameras.json")), 24)[2]
    expected = render(load(shot), viewpoint.camera, numerics=Numerics(antialiased=True)).color
    found = torch.from_numpy(np.load(tmp_path / "a.npy"))
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)
    assert (found - render(load(shot), viewpoint.camera).color).abs().max() > 1e-4
    result = gsedit("diff", shot, marked, "--size", 24, "--count", 1, "--json")
    assert 10 < json.loads(result.stdout.splitlines()[-1])["psnr"] < 90


def test_views_are_searched_for_once(scene, tmp_path, monkeypatch):
    calls = []
    search = around.find_views
    monkeypatch.setattr(around, "find_views", lambda *a, **k: calls.append(a[1]) or search(*a, **k))
    words = ["--region", "sphere:0,0,0,1e6", "--count", 2, "--size", 16]
    result = gsedit("render", scene, *words, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert len(calls) == 1
    assert result.stderr.count("searching the scene") == 1
    assert len(files(tmp_path / "out")) == 2


def test_recorded_cameras_are_read_once(shot, tmp_path):
    words = ["--region", "sphere:0,0,0,1e6", "--views", "5", "--size", 16]
    result = gsedit("render", shot, *words, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert result.stderr.count("cameras of") == 1
    assert [path.name for path in files(tmp_path / "out")] == ["005_shot5.png"]


def test_an_interrupted_animation_leaves_no_file(shot, tmp_path, monkeypatch):
    def broken(frames, *rest, **options):
        def stopping():
            yield next(iter(frames))
            raise KeyboardInterrupt

        animations_write(stopping(), *rest, **options)

    animations_write = animations.write_gif
    monkeypatch.setattr(animations, "write_gif", broken)
    before = set(files(tmp_path))
    result = gsedit("render", shot, "--frames", 3, "--size", 16, "-o", tmp_path / "a.gif")
    assert result.exit_code == 130
    assert set(files(tmp_path)) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.jpg"], "name a folder, a picture"),
        (["-o", "a.png", "--path", "orbit"], "is one picture"),
        (["-o", "a.png", "--count", "2"], "--count is for views in a folder"),
        (["-o", "a.npy", "--show", "color,depth"], "holds one map"),
        (["-o", "a.exr", "--format", "exr"], "--format is for folders"),
        (["-o", "out", "--show", "colour"], "give any of color, depth, normals, alpha"),
        (["-o", "out", "--resolution", "640"], "as in 1280x720"),
        (["-o", "out", "--background", "blakc"], "a color's name"),
        (["-o", "out", "--background", "#ff880080"], "a color's name"),
        (["-o", "a.gif", "--background", "transparent"], "for PNG pictures"),
        (["-o", "out", "--format", "exr", "--background", "transparent"], "leave out --format"),
        (["-o", "out", "--show", "alpha", "--background", "transparent"], "show color alone"),
        (["-o", "a.png", "--depth", "--background", "transparent"], "or name a folder"),
        (["-o", "a.gif", "--fps", "60"], "at most 50"),
        (["-o", "out", "--frames", "9"], "--frames is for a path of cameras: add --path"),
        (["-o", "a.png", "--arc", "90"], "--arc is for a path of cameras"),
        (["-o", "a.gif", "--arc", "90"], "--arc is for --path orbit"),
        (["-o", "a.gif", "--path", "spline", "--elevation", "9"], "a spline keeps to the cameras"),
        (["-o", "out", "--path", "orbit", "--fps", "9"], "--fps is for .mp4 and .gif"),
        (["-o", "a.png", "--frames", "120"], "--frames is for a path of cameras"),
        (["-o", "a.gif", "--crf", "18"], "--crf is for .mp4"),
        (["-o", "out", "--wipe", "b.ply", "--depth"], "--wipe shows colors"),
        (["-o", "a.exr", "--wipe", "b.ply"], "--wipe is written as"),
        (["-o", "out", "--wipe", "b.ply", "--region", "all"], "leave out --wipe"),
        (["-o", "out", "--path", "circle"], "not one of"),
    ],
    ids=" ".join,
)
def test_requests_that_make_no_sense_are_refused_at_once(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = gsedit("render", "missing.ply", *words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert one_line(result.stderr)
    assert not files(tmp_path)
