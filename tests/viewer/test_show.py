"""What is shown is what is there; and nothing but the viewers needs the viewers' libraries."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch
from PIL import Image
from point_clouds import ball, cloud

from gsedit.errors import GseditError, UsageError
from gsedit.files import load
from gsedit.reports.events import Event
from gsedit.viewer import show
from gsedit.views.dataset import View
from gsedit.views.framing import framing_camera
from rasterizer.camera import Camera

BLOCKED = "import sys; sys.modules.update(open3d=None, pyvista=None, vtk=None)\n"


def view(color: float, size: tuple[int, int] = (20, 30)) -> View:
    height, width = size
    pose = torch.eye(4, dtype=torch.float64)
    camera = Camera(pose, 30.0, 30.0, width / 2, height / 2, width, height)
    return View("v", camera, torch.full((height, width, 3), color))


def test_a_picture_holds_the_values():
    image = torch.tensor([[[0.0, 0.5, 1.0], [-1.0, 2.0, 0.2]]])
    assert np.array_equal(np.asarray(show.as_picture(image)), [[[0, 128, 255], [0, 255, 51]]])


def test_contact_sheet_shows_every_row_and_at_most_the_columns():
    rows = [("original", [view(0.0)] * 10), ("edited", [view(1.0)] * 10)]
    wide, narrow = show.contact_sheet(rows), show.contact_sheet(rows, columns=2)
    assert wide.height == narrow.height
    assert (wide.width - show.MARGIN) == 4 * (narrow.width - show.MARGIN)
    single = show.contact_sheet(rows[:1], columns=2)
    assert single.height < narrow.height
    dark = np.asarray(narrow.convert("L")) < 10
    pictures = 2 * show.CELL[0] * round(show.CELL[0] * 20 / 30)  # two black pictures, enlarged
    assert dark.sum() == pytest.approx(pictures, rel=0.05)  # and the ink of two labels


def test_contact_sheet_refuses_rows_that_do_not_match():
    with pytest.raises(ValueError, match="equal"):
        show.contact_sheet([("a", [view(0.0)]), ("b", [view(0.0), view(1.0)])])
    with pytest.raises(ValueError, match="non-zero"):
        show.contact_sheet([])


def test_depth_range_ignores_what_is_not_solid():
    depth = torch.linspace(2, 4, 101)[None].repeat(3, 1)
    alpha = torch.ones_like(depth)
    depth[0], alpha[0] = 1000.0, 0.1
    near, far = show.depth_range(depth, alpha)
    assert 2 <= near < 2.1
    assert 3.9 < far <= 4
    assert show.depth_range(depth, torch.zeros_like(alpha)) == (0.0, 1.0)
    flat = show.depth_range(torch.full((2, 2), 3.0), torch.ones(2, 2))
    assert flat[0] == 3.0 < flat[1]


def test_depth_picture_is_red_near_blue_far_black_where_nothing_is():
    depth = torch.linspace(1, 3, 64)[None].repeat(8, 1)
    alpha = torch.ones_like(depth)
    alpha[:2] = 0
    picture = np.asarray(show.depth_picture(depth, alpha)).astype(int)
    assert picture.shape == (8 + show.STRIP, 64, 3)
    assert (picture[:2] == 0).all()
    near, far = picture[5, 2], picture[5, -3]
    assert near[0] > near[2]  # red
    assert far[2] > far[0]  # blue


@pytest.mark.parametrize(
    "events",
    [[], [Event("fit", 1.0, loss=0.2)], [Event("fit", t, error=0.1 / t) for t in (1.0, 2.0)]],
    ids=["empty", "loss", "error"],
)
def test_error_vs_time_is_a_picture_whatever_was_measured(tmp_path, events):
    path = tmp_path / "curve.png"
    show.error_vs_time(events, path)
    assert np.asarray(Image.open(path).convert("L")).std() > 0
    with pytest.raises(UsageError, match="exists"):
        show.error_vs_time(events, path)


def test_a_scene_with_nothing_to_show_is_refused():
    with pytest.raises(UsageError, match="opacity"):
        show.preview(ball(), min_opacity=0.99)


def test_a_window_needs_a_screen(monkeypatch):
    monkeypatch.setattr(show, "_has_screen", lambda: False)
    with pytest.raises(UsageError, match=r"-o picture\.png"):
        show.preview(ball())


def test_pyvista_points_are_where_the_camera_says():
    pytest.importorskip("pyvista", exc_type=ImportError)
    height, width = 48, 64
    pose = torch.eye(4, dtype=torch.float64)
    pose[2, 3] = 4
    camera = Camera(pose, 60.0, 60.0, 20.0, 30.0, width, height)  # principal point off centre
    scene = cloud(torch.tensor([[0.4, -0.6, 0.2]]), color=(1.0, 0.0, 0.0))
    try:
        picture = np.asarray(show.snapshot(scene, camera, point_size=3.0)).astype(int)
    except GseditError as error:
        pytest.skip(f"no OpenGL here: {error}")
    y, x = np.nonzero(picture[..., 0] - picture[..., 1] > 128)
    expected = camera.project(scene.means.double())[0][0]
    # half a pixel of rasterisation; a point is 3 pixels wide
    assert np.abs(np.array([x.mean() + 0.5, y.mean() + 0.5]) - expected.numpy()).max() < 1


def test_without_opengl_the_advice_is_one_line(monkeypatch):
    monkeypatch.setattr(show, "_PROBE", "import os; os.abort()")  # as VTK ends: by a signal
    monkeypatch.setattr(show, "_pyvista", lambda: None)
    with pytest.raises(GseditError, match="apt-get install -y libegl1") as raised:
        show.snapshot(ball(), framing_camera(ball()))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("degree", [0, 1])
def test_open3d_writes_the_same_scene(tmp_path, degree):
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    generator = torch.Generator().manual_seed(1)
    scene = cloud(torch.randn(6, 3, generator=generator), degree=degree)
    scene = scene.map(lambda field: field + 0.1 * torch.rand(field.shape, generator=generator))
    open3d.t.io.write_point_cloud(str(tmp_path / "o.ply"), show.to_open3d(scene))
    back = load(tmp_path / "o.ply")
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
        # scales go through exp and log: a few float32 roundings
        assert torch.allclose(getattr(back, name), getattr(scene, name), atol=1e-6), name


@pytest.mark.parametrize("viewer", ["to_open3d", "to_pyvista"])
def test_missing_viewers_are_one_line_with_the_next_move(viewer):
    code = BLOCKED + (
        "import torch; from gsedit.viewer import show; from gsedit.errors import GseditError\n"
        "from rasterizer.scene import Gaussians\n"
        "scene = Gaussians(*(torch.zeros(s) for s in ((1, 3), (1, 4), (1, 3), (1,), (1, 1, 3))))\n"
        f"try: show.{viewer}(scene)\n"
        "except GseditError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.count("\n") == 1
    assert "pip install" in done.stdout
