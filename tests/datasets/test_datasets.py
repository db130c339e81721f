"""Datasets: photos, poses and points agree, whatever the format, the lens and the size."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from bad_files import dataset, write
from photo_sets import (
    COLMAP_LENSES,
    cameras,
    colmap_dataset,
    color,
    opengl_camera_to_world,
    rays_of,
)
from PIL import Image

from gsedit import load_dataset
from gsedit.errors import InputError
from gsedit.views.undistort import Lens, distort, undistort, undistortion

LENSES = {
    "pincushion": (Lens(60.0, 62.0, 41.0, 30.5, 80, 60), {"k1": 0.1, "k2": 0.03}),
    "barrel": (Lens(60.0, 62.0, 41.0, 30.5, 80, 60), {"k1": -0.1, "k2": 0.02, "k3": -0.001}),
    "tangential": (Lens(60.0, 62.0, 38.0, 27.0, 80, 60), {"p1": 0.01, "p2": -0.02}),
    "bear": (
        Lens(84.2, 84.1, 40.4, 37.4, 80, 80),
        {"k1": 0.0146, "k2": -0.0283, "p1": 1.5e-4, "p2": 6.1e-4},
    ),
}
lenses = pytest.mark.parametrize(("plain", "bent"), LENSES.values(), ids=LENSES)


def rays_of_photo(plain: Lens, bent: dict[str, float]) -> torch.Tensor:
    """The direction that each pixel center of a distorted photo saw: a fixed point, iterated."""
    seen = rays_of(plain)
    rays = seen.clone()
    for _ in range(100):  # each step leaves less than 3/4 of the error: exact to 1e-12
        rays = rays + (seen - brown_conrady(rays, **bent)) / 2
    return rays


def brown_conrady(rays: torch.Tensor, k1=0.0, k2=0.0, k3=0.0, p1=0.0, p2=0.0) -> torch.Tensor:
    """OpenCV's formula written out, to check the library call and the order of its coefficients."""
    x, y = rays.unbind(-1)
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    x_d = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    y_d = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return torch.stack((x_d, y_d), -1)


@lenses
def test_undistorted_photo_is_the_pinhole_picture(plain, bent):
    """Exact up to bilinear interpolation, whose error falls with the square of the pixel."""
    errors = []
    for scale in (1, 2):
        fine = plain.scaled(plain.width * scale, plain.height * scale)
        undo = undistortion(fine.bent(**bent))
        error = undistort(color(rays_of_photo(fine, bent)), undo) - color(rays_of(undo.lens))
        errors.append(float(error.abs().max()))
    # |f''| h^2 / 8 in each of two directions; f'' of the waves is below 20, h = 1 / focal
    assert errors[0] < 2 * 20 / 8 / plain.fx**2
    if errors[0] > 1e-4:  # else nothing moves by a pixel, and the fraction moved counts instead
        assert errors[1] < errors[0] / 3  # a quarter, but for where the nodes happen to fall


@lenses
def test_distort_is_brown_conrady_and_has_an_inverse(plain, bent):
    rays, lens = rays_of_photo(plain, bent), plain.bent(**bent)
    ideal = lens.zoomed(1.0)
    focal = torch.tensor([lens.fx, lens.fy], dtype=torch.float64)
    xy = rays * focal + torch.tensor([lens.cx, lens.cy], dtype=torch.float64)
    photo = lens.camera(torch.eye(4)).pixel_centers()
    # 1e-9 of 100 pixels: float64 rounding, and what the iteration leaves
    torch.testing.assert_close(distort(xy, ideal, lens), photo, atol=1e-9, rtol=0)


@lenses
def test_zoom_is_enough_and_not_more(plain, bent):
    lens = plain.bent(**bent)
    undo = undistortion(lens)
    assert undo.lookup is not None
    corner = torch.tensor([lens.width - 0.5, lens.height - 0.5], dtype=torch.float64)
    assert (undo.lookup >= 0.5 - 1e-8).all()
    assert (undo.lookup <= corner + 1e-8).all()
    zoom = undo.lens.fx / lens.fx
    assert undo.lens.fy / lens.fy == pytest.approx(zoom)
    assert (undo.lens.cx, undo.lens.cy) == (lens.cx, lens.cy)
    wider = lens.zoomed(zoom * (1 - 1e-6))
    outside = distort(wider.camera(torch.eye(4)).pixel_centers(), wider, lens)
    touches = bool((outside < 0.5).any() or (outside > corner).any())
    assert zoom == 1 or touches


def test_views_are_sorted_and_nerfstudio_poses_are_opencv_world_to_camera(tmp_path):
    record = dataset(tmp_path)
    for frame, camera in zip(record["frames"], cameras()):
        frame["transform_matrix"] = opengl_camera_to_world(camera)
    sorted_views = load_dataset(write(tmp_path, record)).views
    for view, camera in zip(sorted_views, cameras(), strict=True):
        # four roundings of float64 at unit size
        torch.testing.assert_close(
            view.camera.world_to_camera, camera.world_to_camera, atol=1e-15, rtol=1e-14
        )
    record["frames"].reverse()
    views = load_dataset(write(tmp_path, record) / "transforms.json").views
    assert [v.name for v in views] == ["images/0.png", "images/1.png", "images/2.png"]
    for a, b in zip(views, sorted_views):
        assert torch.equal(a.camera.world_to_camera, b.camera.world_to_camera)
        assert torch.equal(a.image, b.image)
    assert [float(v.image.mean()) for v in views] == pytest.approx([0, 40 / 255, 80 / 255])


def test_blender_style(tmp_path):
    """An angle instead of intrinsics, names without suffix, transparent photos (over black)."""
    record = dataset(tmp_path)
    for key in ("w", "h", "fl_x"):
        del record[key]
    record["camera_angle_x"] = 2 * math.atan(0.5)
    for frame in record["frames"]:
        frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")
    pixels = np.zeros((6, 8, 4), np.uint8)
    pixels[..., 0], pixels[..., 3] = 255, 51  # a fifth of red
    Image.fromarray(pixels).save(tmp_path / "images" / "0.png")
    view = load_dataset(write(tmp_path, record)).views[0]
    assert view.name == "images/0.png"
    assert (view.camera.fx, view.camera.width, view.camera.height) == (pytest.approx(8.0), 8, 6)
    torch.testing.assert_close(view.image[0, 0], torch.tensor([0.2, 0.0, 0.0]))
    assert view.alpha is not None
    torch.testing.assert_close(view.alpha, torch.full((6, 8), 0.2))


@pytest.mark.parametrize("named", [True, False])
def test_sparse_points(named, tmp_path):
    record = dataset(tmp_path)
    if named:
        record["ply_file_path"] = "cloud.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 2\n"
    head += "".join(f"property float {c}\n" for c in "xyz")
    head += "".join(f"property uint8 {c}\n" for c in ("red", "green", "blue")) + "end_header\n"
    body = "1 2 3 255 0 51\n-1 -2 -3 0 0 0\n"
    (tmp_path / ("cloud.ply" if named else "points3D.ply")).write_text(head + body)
    points = load_dataset(write(tmp_path, record))
    assert points.points is not None
    assert points.point_colors is not None
    assert points.points.tolist() == [[1, 2, 3], [-1, -2, -3]]
    torch.testing.assert_close(points.point_colors[0], torch.tensor([1, 0, 0.2]))


@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
@pytest.mark.parametrize("model", COLMAP_LENSES)
def test_colmap(model, text, tmp_path):
    data = load_dataset(colmap_dataset(tmp_path, model, text))
    lens = COLMAP_LENSES[model][1]
    ideal = undistortion(lens).lens
    assert [view.name for view in data.views] == ["0.png", "1.png", "2.png"]
    assert [float(v.image.mean()) for v in data.views] == pytest.approx([0, 40 / 255, 80 / 255])
    for view, expected in zip(data.views, cameras()):
        camera = view.camera
        torch.testing.assert_close(camera.world_to_camera, expected.world_to_camera)
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        assert intrinsics == (ideal.fx, ideal.fy, ideal.cx, ideal.cy)
    assert data.points is not None
    assert data.point_colors is not None
    assert data.points.tolist() == [[1, 2, 3]]
    torch.testing.assert_close(data.point_colors, torch.tensor([[1, 0, 0.2]]))


@pytest.mark.parametrize("name", ["cameras", "images", "points3D", "frames", "rigs"])
@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
def test_cut_colmap_file_is_an_error_not_a_crash(name, text, tmp_path):
    model = colmap_dataset(tmp_path, text=text) / "sparse" / "0"
    file = model / f"{name}.{'txt' if text else 'bin'}"
    content = file.read_bytes()
    keep = len(content) - 11 if not text else content.rstrip().rindex(b"\n") + 4
    file.write_bytes(content[:keep])
    with pytest.raises(InputError) as raised:
        load_dataset(tmp_path)
    assert str(model) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_colmap_photo_must_exist_and_stay_inside(tmp_path):
    folder = colmap_dataset(tmp_path)
    (folder / "images" / "1.png").unlink()
    with pytest.raises(InputError, match=r"3 photos and 1 of them is not there \(1\.png\)"):
        load_dataset(folder)
    (folder / "images" / "1.png").symlink_to(Path(__file__))
    with pytest.raises(InputError, match="leaves the dataset"):
        load_dataset(folder)
