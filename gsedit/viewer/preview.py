"""A quick look at a scene as a point cloud (pyvista): a window, or a picture drawn off screen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.files.pictures import save_picture
from gsedit.viewer.libraries import check_drawing, has_screen, import_pyvista
from gsedit.viewer.point_clouds import to_pyvista
from gsedit.views.framing import framing_camera, guess_up
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians


def snapshot(scene: Gaussians, camera: Camera, *, point_size: float | None = None) -> Image.Image:
    """The scene's centres as coloured points as `camera` sees them, drawn off screen.

    Raises GseditError where pyvista or OpenGL is missing.
    """
    check_drawing()
    plotter = _plotter(scene, camera, point_size, off_screen=True)
    try:
        return Image.fromarray(np.asarray(plotter.screenshot(return_img=True))[..., :3])
    finally:
        plotter.close()


def preview(
    scene: Gaussians,
    path: Path | str | None = None,
    *,
    camera: Camera | None = None,
    up: Float[Tensor, "3"] | None = None,
    size: tuple[int, int] = (960, 720),
    min_opacity: float = 0.1,
    point_size: float | None = None,
    overwrite: bool = False,
) -> None:
    """Show the scene as a point cloud: into a PNG at `path`, or in a window without `path`.

    Gaussians fainter than `min_opacity` are left out. Without a camera one is chosen by
    `framing_camera(up=, size=)`; `size` is (width, height) and `point_size` is in pixels. Raises
    UsageError where nothing is left, or there is no screen for a window; GseditError where pyvista
    or OpenGL is missing.
    """
    up = guess_up(scene) if up is None else up
    solid = scene[scene.opacities >= min_opacity]
    if not len(solid):
        raise UsageError(f"no Gaussian has an opacity of {min_opacity} or more: lower min_opacity")
    camera = camera or framing_camera(solid, up=up, size=size)
    if path is not None:
        save_picture(snapshot(solid, camera, point_size=point_size), path, overwrite=overwrite)
        return
    if not has_screen():
        raise UsageError("there is no screen to open a window on: give -o picture.png")
    check_drawing()
    _plotter(solid, camera, point_size, off_screen=False).show()


def _plotter(scene: Gaussians, camera: Camera, point_size: float | None, off_screen: bool) -> Any:
    pyvista = import_pyvista()
    width, height = camera.width, camera.height
    # a surface of n points looks closed when each is about as large as its share of the picture
    size = point_size or min(max((width * height / len(scene)) ** 0.5, 3.0), 12.0)
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=[width, height])
    plotter.set_background("white")
    plotter.add_points(
        to_pyvista(scene), scalars="rgb", rgb=True, point_size=size, render_points_as_spheres=False
    )
    position = camera.centre.detach().double()
    view = plotter.camera
    view.position = position.tolist()
    view.focal_point = (position + camera.forward.detach().double()).tolist()
    view.up = (-camera.rotation[1].detach().double()).tolist()
    view.view_angle = float(np.degrees(2 * np.arctan(height / 2 / camera.fy)))
    view.SetWindowCenter(
        -2 * (camera.cx - width / 2) / width, 2 * (camera.cy - height / 2) / height
    )
    plotter.reset_camera_clipping_range()
    return plotter
