"""Scenes and results as something to look at: contact sheets, depth pictures, curves, point clouds.

`n` Gaussians, `h w` pixels. Only the functions that say so import open3d or pyvista: everything
else works where those cannot be loaded.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from gsedit.errors import GseditError, UsageError
from gsedit.files.atomic import atomic_path
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.reports.events import Event
from gsedit.reports.figures import curves
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.framing import framing_camera, guess_up
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

COLUMNS = 8  # more views than this on one sheet are too small to judge
CELL = (
    128,
    320,
)  # pixels: smaller pictures are enlarged to the first, larger reduced to the second
MARGIN, STRIP = 4, 22  # pixels between cells, and above a row for its label
SOLID = 0.5  # a pixel shows a surface where at least half of it is covered


def as_picture(image: Float[Tensor, "h w 3"]) -> Image.Image:
    """An 8-bit picture of sRGB values in [0, 1]; values outside are clipped."""
    levels = (image.detach().clamp(0, 1) * 255).round().to(torch.uint8)
    return Image.fromarray(levels.cpu().numpy())


def save_picture(picture: Image.Image, path: Path | str, *, overwrite: bool = False) -> None:
    """Write a PNG, whole or not at all."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        picture.save(temporary, format="PNG")


def contact_sheet(
    rows: Sequence[tuple[str, Sequence[View]]], *, columns: int = COLUMNS
) -> Image.Image:
    """Rows of labelled pictures, one column a camera: original, edited target, final render.

    Every row holds the same cameras in the same order; beyond `columns` of them, evenly spaced ones
    are shown. Raises ValueError where the rows are empty or differ in length.
    """
    counts = {len(views) for _, views in rows}
    if len(counts) != 1 or 0 in counts:
        raise ValueError(f"a sheet needs rows of equal, non-zero length; got {sorted(counts)}")
    shown = evenly_spaced(counts.pop(), columns)
    cell_w, cell_h = _cell_size([views[i] for _, views in rows for i in shown])
    row_h = STRIP + cell_h + MARGIN
    sheet = Image.new(
        "RGB", (MARGIN + len(shown) * (cell_w + MARGIN), MARGIN + len(rows) * row_h), "white"
    )
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for row, (label, views) in enumerate(rows):
        top = MARGIN + row * row_h
        draw.text((MARGIN, top + 2), label, fill="black", font=font)
        for column, index in enumerate(shown):
            picture = _fitted(as_picture(views[index].image), cell_w, cell_h)
            left = MARGIN + column * (cell_w + MARGIN) + (cell_w - picture.width) // 2
            sheet.paste(picture, (left, top + STRIP + (cell_h - picture.height) // 2))
    return sheet


def _cell_size(views: Sequence[View]) -> tuple[int, int]:
    """Width and height that the largest picture gets, its longer side within CELL."""
    width, height = (max(view.image.shape[axis] for view in views) for axis in (1, 0))
    longest = max(width, height)
    scale = min(max(longest, CELL[0]), CELL[1]) / longest
    return round(width * scale), round(height * scale)


def _fitted(picture: Image.Image, width: int, height: int) -> Image.Image:
    scale = min(width / picture.width, height / picture.height)
    size = (max(1, round(picture.width * scale)), max(1, round(picture.height * scale)))
    return picture.resize(size, Image.Resampling.LANCZOS)


def depth_range(depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"]) -> tuple[float, float]:
    """The near and far ends of a colour scale: 2 % and 98 % of the depths of solid pixels.

    (0, 1) where nothing is solid; never an empty range.
    """
    solid = depth[(alpha > SOLID) & depth.isfinite()]
    if not len(solid):
        return 0.0, 1.0
    ordered = solid.detach().double().sort().values
    near, far = (float(ordered[round(q * (len(ordered) - 1))]) for q in (0.02, 0.98))
    return near, max(far, near + 1e-6 * max(abs(near), 1.0))


def depth_picture(depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"]) -> Image.Image:
    """Depth in colour, near is red and far is blue, with the range (scene units) written below.

    Pixels less than half covered are black: they have no surface.
    """
    from matplotlib import colormaps

    turbo = colormaps["turbo"]
    near, far = depth_range(depth, alpha)
    nearness = ((far - depth.detach()) / (far - near)).clamp(0, 1).nan_to_num()
    colors = turbo(nearness.cpu().numpy())[..., :3]
    colors = colors * (alpha.detach() > SOLID).cpu().numpy()[..., None]
    picture = Image.fromarray((colors * 255).round().astype(np.uint8))

    legend = Image.new("RGB", (picture.width, STRIP), "white")
    ramp = (turbo(np.linspace(1, 0, picture.width))[:, :3] * 255).round().astype(np.uint8)
    legend.paste(Image.fromarray(np.tile(ramp, (STRIP // 3, 1, 1))), (0, 0))
    draw, font = ImageDraw.Draw(legend), ImageFont.load_default(11)
    draw.text((2, STRIP // 3), f"{near:.3g}", fill="black", font=font)
    draw.text((picture.width - 2, STRIP // 3), f"{far:.3g}", fill="black", font=font, anchor="ra")

    joined = Image.new("RGB", (picture.width, picture.height + STRIP))
    joined.paste(picture, (0, 0))
    joined.paste(legend, (0, picture.height))
    return joined


def error_vs_time(events: Iterable[Event], path: Path | str, *, overwrite: bool = False) -> None:
    """A PNG of error and loss against run time, a curve a stage. Needs no screen."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    events = list(events)
    figure = Figure(figsize=(7, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    fields: tuple[Literal["error", "loss"], ...] = ("error", "loss")
    for axes, field in zip((upper, lower), fields):
        for stage, points in curves(events, field).items():
            axes.plot(*zip(*points), marker=".", label=stage)
        if axes.has_data():
            axes.legend()
        else:
            axes.text(0.5, 0.5, f"no {field} was measured", ha="center", transform=axes.transAxes)
        axes.grid(alpha=0.3)
    upper.set_ylabel("error (RMSE of colours in [0, 1])")
    lower.set_ylabel("loss")
    lower.set_xlabel("seconds since the start")
    lower.set_xlim(left=0)
    _add_decibels(upper)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _add_decibels(axes: Any) -> None:
    """The same axis read as PSNR, where the curves have an error above zero."""
    high = axes.get_ylim()[1]
    if not axes.lines or high <= 0:
        return
    axes.set_ylim(0, high)
    ticks = [tick for tick in axes.get_yticks() if 1e-9 < tick <= high]  # 0 has no decibels
    right = axes.twinx()
    right.set_ylim(axes.get_ylim())
    right.set_yticks(ticks, [f"{psnr_from_rmse(tick):.1f}" for tick in ticks])
    right.set_ylabel("PSNR, dB")


def splat_colors(scene: Gaussians) -> Float[Tensor, "n 3"]:
    """The colour of every Gaussian without its view dependence (SH degree 0), in [0, 1]."""
    return (0.5 + SH_DC * scene.sh[:, 0]).detach().clamp(0, 1)


def to_open3d(scene: Gaussians) -> Any:
    """An `open3d.t.geometry.PointCloud` with Open3D's names for splats. Imports open3d.

    positions; scale `n 3` (linear); rot `n 4` (wxyz); opacity `n 1` (logit); f_dc `n 3`; f_rest
    `n k-1 3`. Its rotate() turns SH wrongly: turn the scene before.

    Raises GseditError without open3d.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise GseditError(
            f"open3d cannot be loaded ({error}); try: pip install open3d-cpu, and on Debian "
            "apt-get install -y libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0"
        ) from error

    fields = {
        "positions": scene.means,
        "scale": scene.scales,
        "rot": scene.quats,
        "opacity": scene.logit_opacities[:, None],
        "f_dc": scene.sh[:, 0],
        "f_rest": scene.sh[:, 1:],
    }
    cloud = open3d.t.geometry.PointCloud()
    for name, field in fields.items():
        if field.numel() or name != "f_rest":
            values = field.detach().float().contiguous().cpu().numpy()
            cloud.point[name] = open3d.core.Tensor.from_numpy(values).clone()
    return cloud


def to_pyvista(scene: Gaussians) -> Any:
    """A `pyvista.PolyData` of the centres, with `rgb` (uint8), `opacity` and `scales`.

    Imports pyvista; raises GseditError without pyvista.
    """
    cloud = _pyvista().PolyData(scene.means.detach().double().cpu().numpy())
    cloud["rgb"] = (splat_colors(scene) * 255).round().to(torch.uint8).cpu().numpy()
    cloud["opacity"] = scene.opacities.detach().cpu().numpy()
    cloud["scales"] = scene.scales.detach().cpu().numpy()
    return cloud


def snapshot(scene: Gaussians, camera: Camera, *, point_size: float | None = None) -> Image.Image:
    """The scene's centres as coloured points as `camera` sees them, off screen. Imports pyvista."""
    _check_drawing()
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
    """Show the scene as a point cloud: into a PNG at `path`, or in a window. Imports pyvista.

    Gaussians fainter than `min_opacity` are left out. Without a camera one is chosen by
    `framing_camera(up=, size=)`. Raises UsageError where nothing is left, or there is no screen for
    a window; GseditError where pyvista or OpenGL is missing.
    """
    up = guess_up(scene) if up is None else up
    solid = scene[scene.opacities >= min_opacity]
    if not len(solid):
        raise UsageError(f"no Gaussian has an opacity of {min_opacity} or more: lower min_opacity")
    camera = camera or framing_camera(solid, up=up, size=size)
    if path is not None:
        save_picture(snapshot(solid, camera, point_size=point_size), path, overwrite=overwrite)
        return
    if not _has_screen():
        raise UsageError("there is no screen to open a window on: give -o picture.png")
    _check_drawing()
    _plotter(solid, camera, point_size, off_screen=False).show()


def _plotter(scene: Gaussians, camera: Camera, point_size: float | None, off_screen: bool) -> Any:
    pyvista = _pyvista()
    width, height = camera.width, camera.height
    # a surface of n points looks closed when each is about as large as its share of the picture
    size = point_size or min(max((width * height / len(scene)) ** 0.5, 3.0), 12.0)
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=[width, height])
    plotter.set_background("white")
    plotter.add_points(
        to_pyvista(scene), scalars="rgb", rgb=True, point_size=size, render_points_as_spheres=False
    )
    eye = camera.centre.detach().double()
    view = plotter.camera
    view.position = eye.tolist()
    view.focal_point = (eye + camera.forward.detach().double()).tolist()
    view.up = (-camera.rotation[1].detach().double()).tolist()
    view.view_angle = float(np.degrees(2 * np.arctan(height / 2 / camera.fy)))
    view.SetWindowCenter(
        -2 * (camera.cx - width / 2) / width, 2 * (camera.cy - height / 2) / height
    )
    plotter.reset_camera_clipping_range()
    return plotter


def _pyvista() -> Any:
    if not _has_screen():  # must be set before VTK is loaded: without it VTK wants an X server
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista
    except (ImportError, OSError) as error:
        raise GseditError(
            f"pyvista cannot be loaded ({error}); try: pip install pyvista"
        ) from error
    return pyvista


def _has_screen() -> bool:
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16])
plotter.add_points(pyvista.PolyData([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
plotter.screenshot(return_img=True)
"""


def _check_drawing() -> None:
    """Draw two points in another process: without OpenGL, VTK ends the process it runs in."""
    _pyvista()
    probe = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, check=False)
    if probe.returncode:
        raise GseditError(
            "pyvista finds no OpenGL to draw with; on Debian: "
            "apt-get install -y libegl1 libgl1 libgl1-mesa-dri libx11-6"
        )
