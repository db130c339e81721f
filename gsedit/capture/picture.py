"""A picture of a capture: its cameras and points, from the side and from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image

from gsedit.formats.pictures import save_picture as write_picture
from gsedit.pictures.viewer.drawing import EDGES, SHARE, aim, pyramids
from gsedit.pictures.viewer.libraries import check_drawing, import_pyvista
from rasterizer.camera import Camera, look_at

SIZE_PIXELS = (800, 640)
"""Size of each of the two views, (width, height) in pixels."""
FOV = 40.0
TILT = 25.0
"""Degrees by which the view from the side looks down."""
NEAR_POINTS = 0.7
"""Share of the points, the nearest to the cameras, that must be in view: the rest is background."""
FARTHEST = 1.6
"""Largest distance of framed points, in units of the farthest camera's: a far background is not
framed."""
COLORMAP = "viridis"


def save_picture(
    points: Float[np.ndarray, "n 3"],
    colors: Float[np.ndarray, "n 3"],
    cameras: Sequence[Camera],
    path: Path,
    *,
    overwrite: bool = False,
) -> None:
    """Draw the points and cameras of an upright world (y down) off screen, into a PNG.

    `colors`: RGB in [0, 1]. The pyramid of a camera is colored by its place in the order. Raises
    GseditError where pyvista or OpenGL is missing, UsageError as `atomic_path`.
    """
    check_drawing()
    plotter = _plotter(points, colors, cameras)
    try:
        pixels = np.asarray(plotter.screenshot(return_img=True))[..., :3]
    finally:
        plotter.close()
    write_picture(Image.fromarray(pixels), path, overwrite=overwrite)


def _plotter(
    points: Float[np.ndarray, "n 3"], colors: Float[np.ndarray, "n 3"], cameras: Sequence[Camera]
) -> Any:
    """The two views, not yet shown."""
    pyvista = import_pyvista()
    middle, radius = framing(points, cameras)
    plotter = pyvista.Plotter(
        off_screen=True, shape=(1, 2), window_size=[2 * SIZE_PIXELS[0], SIZE_PIXELS[1]], border=True
    )
    plotter.set_background("white", all_renderers=True)
    titles = f"{len(cameras)} cameras, {len(points):,} points", "from above"
    for column, title in enumerate(titles):
        plotter.subplot(0, column)
        if len(points):
            levels = (255 * np.clip(colors, 0, 1)).round().astype(np.uint8)
            cloud = pyvista.PolyData(np.asarray(points, dtype=np.float64))
            plotter.add_points(cloud, scalars=levels, rgb=True, point_size=3.0)
        _add_cameras(plotter, cameras, radius, bar=column == 0)
        plotter.add_text(title, font_size=11, color="black", position="upper_left")
        aim(plotter.camera, _viewer(middle, radius, from_above=column == 1))
        plotter.reset_camera_clipping_range()
    return plotter


def framing(
    points: Float[np.ndarray, "n 3"], cameras: Sequence[Camera]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Middle and radius of the ball that is shown: all cameras, and the points near them."""
    centers = np.stack([camera.center.detach().double().numpy() for camera in cameras])
    middle = (centers.min(0) + centers.max(0)) / 2
    radius = float(np.linalg.norm(centers - middle, axis=1).max())
    if len(points):
        distance = np.linalg.norm(points - middle, axis=1)
        reach = float(np.quantile(distance, NEAR_POINTS))
        radius = max(radius, min(reach, FARTHEST * radius) if radius else reach)
    return middle, 1.1 * radius or 1.0


def _viewer(middle: Float[np.ndarray, "3"], radius: float, *, from_above: bool) -> Camera:
    """A camera outside the ball that sees it whole."""
    target = torch.from_numpy(middle)
    distance = radius / np.sin(np.radians(FOV / 2))
    tilt = np.radians(TILT)
    if from_above:
        direction, up = (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)
    else:
        direction, up = (0.0, -float(np.sin(tilt)), -float(np.cos(tilt))), (0.0, -1.0, 0.0)
    eye = target + distance * torch.tensor(direction, dtype=torch.float64)
    return look_at(eye, target, torch.tensor(up), FOV, *SIZE_PIXELS)


def _add_cameras(plotter: Any, cameras: Sequence[Camera], radius: float, *, bar: bool) -> None:
    """Pyramids, the first and the last camera at the two ends of the colors."""
    actor = plotter.add_mesh(
        pyramids(cameras, 1.5 * SHARE * radius),
        scalars=np.repeat(np.arange(len(cameras)) + 1.0, len(EDGES)), preference="cell",
        cmap=COLORMAP, clim=[1, max(2, len(cameras))], line_width=2.0, show_scalar_bar=False,
    )  # fmt: skip
    if bar and len(cameras) > 1:
        plotter.add_scalar_bar(
            "order of the photos", mapper=actor.mapper, color="black", n_labels=2, fmt="%.0f",
            title_font_size=14, label_font_size=12, width=0.4, height=0.09, position_x=0.3,
            position_y=0.01, vertical=False, background_color="white", fill=True,
        )  # fmt: skip
