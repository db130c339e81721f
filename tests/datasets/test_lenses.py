"""Fisheyes and rational models are undone to the ideal pinhole, through pycolmap."""

from __future__ import annotations

import pytest
import torch
from bad_files import dataset, write
from photo_sets import cameras, color, rays_of
from PIL import Image

from gsedit import load_dataset
from gsedit.views.undistort import ColmapLens, Lens, undistort, undistortion

K = (0.02, -0.01, 0.004, -0.001)
SIZE = (80, 60)
MODELS = {
    "OPENCV_FISHEYE": (45.0, 46.0, 41.0, 30.5, *K),
    "FULL_OPENCV": (60.0, 62.0, 41.0, 30.5, 0.1, 0.02, 1e-3, -2e-3, 0.003, 0.05, 0.01, 0.002),
    "FOV": (60.0, 60.0, 40.0, 30.0, 0.6),
    "RADIAL_FISHEYE": (45.0, 40.0, 30.0, 0.03, 0.001),
    "THIN_PRISM_FISHEYE": (45.0, 46.0, 41.0, 30.5, *K[:2], 1e-3, 1e-3, *K[2:], 1e-3, -1e-3),
}


def lens_of(model: str) -> Lens:
    params = MODELS[model]
    one_focal = model == "RADIAL_FISHEYE"
    fx, fy, cx, cy = (params[0], *params[:3]) if one_focal else params[:4]
    return Lens(fx, fy, cx, cy, *SIZE, distorted=ColmapLens(model, params, *SIZE))


def camera_of(model: str):
    import pycolmap

    return pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], params=MODELS[model])


def photo_of(model: str) -> torch.Tensor:
    """Picture of `color` through the lens: each pixel's ray by pycolmap's inverse."""
    centers = lens_of(model).camera(torch.eye(4)).pixel_centers()
    rays = camera_of(model).cam_from_img(centers.reshape(-1, 2).numpy())
    return color(torch.from_numpy(rays).reshape(centers.shape))


@pytest.mark.parametrize("model", MODELS)
def test_undistorted_photo_is_the_pinhole_picture(model):
    lens = lens_of(model)
    undo = undistortion(lens)
    error = undistort(photo_of(model), undo) - color(rays_of(undo.lens))
    # as in test_datasets: bilinear, curvature of the waves below 20, pixels of 1 / focal
    assert error.abs().max() < 2 * 20 / 8 / lens.fx**2
    assert undo.lens.distorted is None
    assert undo.lookup is not None
    assert undo.lookup.isfinite().all()


def nerfstudio_record(model: str, folder) -> dict:
    record = dataset(folder, size=SIZE)
    params = MODELS[model]
    names = {
        "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
        "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    }[model]
    record |= dict(zip(("fl_x", "fl_y", "cx", "cy", *names), params)) | {"camera_model": model}
    levels = (photo_of(model) * 255).round().byte().numpy()
    Image.fromarray(levels).save(folder / "images/1.png")
    return record


@pytest.mark.parametrize("model", ["OPENCV_FISHEYE", "FULL_OPENCV"])
def test_nerfstudio_and_colmap_read_the_same_lens(model, tmp_path):
    import pycolmap

    record = nerfstudio_record(model, tmp_path)
    view = load_dataset(write(tmp_path, record)).views[1]
    rays = (view.camera.pixel_centers() - torch.tensor([view.camera.cx, view.camera.cy])) / (
        torch.tensor([view.camera.fx, view.camera.fy])
    )
    assert (view.image - color(rays)).abs().max() < 2 * 20 / 8 / view.camera.fx**2 + 1 / 255
    (tmp_path / "transforms.json").unlink()
    made = pycolmap.Reconstruction()
    camera = camera_of(model)
    camera.camera_id = 1
    made.add_camera_with_trivial_rig(camera)
    for i, each in enumerate(cameras()):
        image = pycolmap.Image(name=f"{i}.png", camera_id=1, image_id=i + 1)
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(each.world_to_camera[:3].numpy()))
    (tmp_path / "sparse/0").mkdir(parents=True)
    made.write(tmp_path / "sparse/0")
    again = load_dataset(tmp_path).views[1]
    assert torch.equal(again.image, view.image)
    assert (again.camera.fx, again.camera.fy) == (view.camera.fx, view.camera.fy)
