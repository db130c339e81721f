"""A scene as points, ellipsoids, cameras and color bars (pyvista): a window, or a picture drawn off
screen. `n` Gaussians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.formats.pictures import eight_bits, save_picture
from gsedit.formats.ply.inria import field_columns
from gsedit.pictures.viewer.libraries import check_drawing, check_screen, import_pyvista
from gsedit.pictures.viewer.point_clouds import solid, splat_colors
from gsedit.run.environment import load_extra
from gsedit.scene.framing import bounds, framing_camera
from gsedit.scene.table import table_of
from gsedit.select.region import TINT, TINT_STRENGTH
from gsedit.select.values import NAMED
from gsedit.views.around import cameras_of
from gsedit.views.paths import up_of
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

COLOR = "color"
SELECTION = "selection"
DEPTH = "depth"
CLIPPED = (1.0, 99.0)
"""Percentiles at the ends of a color bar: a capture's outliers would take the rest of the bar."""

_ON_A_LOG_SCALE = ("size", "longest", "shortest", "anisotropy")
_LENGTHS = ("x", "y", "z", "size", "longest", "shortest")
NAMES = (COLOR, SELECTION, DEPTH, *NAMED)
"""Attributes with a name; columns of a file can be given beside them."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """Numbers to color by, one a Gaussian."""

    values: Float[np.ndarray, " n"]
    title: str
    """Name and unit, for the color bar."""
    log: bool
    """Whether the color bar is logarithmic; the values are then positive."""


def attribute(
    scene: Gaussians, name: str, camera: Camera, extra: Mapping[str, np.ndarray] | None = None
) -> Attribute:
    """The attribute of that name: one of NAMES but `color` and `selection`, a column of `extra`
    (one value a Gaussian), or `f_rest_N` and the other columns of INRIA's .ply.

    Raises UsageError for any other name.
    """
    scene = scene.detach()
    if name == DEPTH:
        depth = camera.project(scene.means.double())[1].cpu().numpy()
        seen = np.where(depth > 0, depth, np.nan)  # what is behind would take half of the bar
        return Attribute(seen, "depth along the view of the first picture, scene units", False)
    if name in NAMED:
        what, values = NAMED[name]
        unit = ", scene units" if name in _LENGTHS else ""
        numbers = np.asarray(values(table_of(scene)), dtype=np.float64)
        return Attribute(numbers, f"{name}: {what}{unit}", name in _ON_A_LOG_SCALE)
    if extra and name in extra:
        return Attribute(
            np.asarray(extra[name], dtype=np.float64), f"{name}, as in the file", False
        )
    table = table_of(scene)
    for field_name, columns in field_columns(table.sh.shape[1]).items():
        if name in columns:
            column = getattr(table, field_name)[:, columns == name][:, 0].astype(np.float64)
            return Attribute(column, f"{name}, as in INRIA's .ply", False)
    known = (*NAMES, *(extra or ()))
    close = get_close_matches(name, known, 1)
    move = (
        f"did you mean {close[0]}?" if close else f"choose one of {', '.join(known)}, f_dc_0, ..."
    )
    raise UsageError(f"there is nothing named '{name}' to color by: {move}")


def limits(attributes: list[Attribute]) -> tuple[float, float]:
    """The ends of one color bar for all of them: the CLIPPED percentiles."""
    values = np.concatenate([each.values for each in attributes])
    values = values[np.isfinite(values)]
    low, high = np.percentile(values, CLIPPED) if len(values) else (0.0, 0.0)
    if high <= low:  # one value: the bar still needs a length
        high = low + max(abs(low), 1.0) * 1e-3
    return float(low), float(high)


ELLIPSOID_RADIUS = 2.0
"""Standard deviations: where a Gaussian has 14 % of its opacity left."""
SPARSE_COLOR = (230, 90, 20)
CAMERA_COLOR = (20, 60, 200)


@dataclass(frozen=True, eq=False)
class Panel:
    """One scene of a picture; two of them are drawn side by side."""

    scene: Gaussians
    title: str = ""
    selection: Bool[Tensor, " n"] | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Other columns of the file, one value a Gaussian."""

    def __getitem__(self, rows: Bool[Tensor, " n"]) -> Panel:
        chosen = None if self.selection is None else self.selection[rows]
        extra = {name: column[rows.numpy()] for name, column in self.extra.items()}
        return Panel(self.scene[rows], self.title, chosen, extra)


@dataclass(frozen=True)
class Look:
    """How Gaussians are drawn."""

    color_by: str = COLOR
    """`color`, `selection`, or the name of an attribute."""
    colormap: str = "viridis"
    """A name of matplotlib's, for attributes."""
    point_size: float | None = None
    """Pixels; None: from the number of points."""
    ellipsoids: bool = False
    """Draw the selection, or all where there is none, as ellipsoids."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Objects that are drawn beside the Gaussians."""

    cameras: tuple[Viewpoint, ...] = ()
    points: Float[Tensor, "m 3"] | None = None
    """A sparse cloud, world units."""


def make_plotter(
    panels: Sequence[Panel], camera: Camera, look: Look, around: Surroundings, *, off_screen: bool
) -> Any:
    """A pyvista.Plotter of the panels side by side, each as `camera` sees it, not yet shown.

    Raises UsageError for an unknown attribute or color map, or too many ellipsoids.
    """
    pyvista = import_pyvista()
    attributes = None
    if look.color_by not in (COLOR, SELECTION):
        if look.colormap not in load_extra("matplotlib", "a color map").colormaps:
            raise UsageError(
                f"'{look.colormap}' is no color map of matplotlib: try viridis, magma or turbo"
            )
        attributes = [attribute(p.scene, look.color_by, camera, p.extra) for p in panels]
    plotter = pyvista.Plotter(
        off_screen=off_screen,
        shape=(1, len(panels)),
        window_size=[camera.width * len(panels), camera.height],
        border=len(panels) > 1,
    )
    plotter.set_background("white", all_renderers=True)
    for column, panel in enumerate(panels):
        plotter.subplot(0, column)
        options = _coloring(panel, attributes, column, look)
        mapper = _add_panel(plotter, panel, camera, look, options)
        _add_surroundings(plotter, panels[0].scene, around)
        if panel.title:
            plotter.add_text(panel.title, font_size=10, color="black", position="upper_left")
        aim(plotter.camera, camera)
        plotter.reset_camera_clipping_range()
        if attributes and panel is panels[-1]:
            _add_bar(plotter, mapper, attributes[0], look)
    if len(panels) > 1:
        plotter.link_views()
    return plotter


def panel_colors(panel: Panel, look: Look) -> UInt8[np.ndarray, "n 3"]:
    """The Gaussians' own colors; with `selection`, what is selected is tinted."""
    colors = splat_colors(panel.scene)
    if look.color_by == SELECTION and panel.selection is not None:
        tint = torch.tensor(TINT).to(colors)
        colors[panel.selection] = torch.lerp(colors[panel.selection], tint, TINT_STRENGTH)
    return eight_bits(colors)


def aim(view: Any, camera: Camera) -> None:
    """Give a camera of VTK the pose and the pinhole of ours."""
    width, height = camera.width, camera.height
    position = camera.center.detach().double()
    view.position = position.tolist()
    view.focal_point = (position + camera.forward.detach().double()).tolist()
    view.up = (-camera.rotation[1].detach().double()).tolist()
    view.view_angle = float(np.degrees(2 * np.arctan(height / 2 / camera.fy)))
    view.SetWindowCenter(
        -2 * (camera.cx - width / 2) / width, 2 * (camera.cy - height / 2) / height
    )


def _coloring(
    panel: Panel, attributes: list[Attribute] | None, column: int, look: Look
) -> tuple[np.ndarray, dict[str, Any]]:
    """Values of the points, and what pyvista is told of them."""
    if attributes is None:
        return panel_colors(panel, look), {"rgb": True}
    chosen = attributes[column]
    return chosen.values, {
        "cmap": look.colormap, "clim": limits(attributes), "log_scale": chosen.log,
        "show_scalar_bar": False,
    }  # fmt: skip


def _add_panel(
    plotter: Any,
    panel: Panel,
    camera: Camera,
    look: Look,
    coloring: tuple[np.ndarray, dict[str, Any]],
) -> Any:
    """Add the points and ellipsoids of a panel; the VTK mapper that knows their colors."""
    pyvista = import_pyvista()
    values, options = coloring
    solid, actor = np.zeros(len(panel.scene), dtype=bool), None
    if look.ellipsoids:
        solid[:] = True if panel.selection is None else panel.selection.numpy()
    if not solid.all():
        cloud = pyvista.PolyData(panel.scene.means.detach().double().numpy()[~solid])
        # a surface of n points looks closed when each is about as large as its share of the picture
        share = (camera.width * camera.height / len(panel.scene)) ** 0.5
        size = look.point_size or min(max(share, 3.0), 12.0)
        actor = plotter.add_points(
            cloud, scalars=values[~solid], point_size=size, render_points_as_spheres=False,
            **options,
        )  # fmt: skip
    if solid.any():
        rows = torch.from_numpy(solid)
        vertices, faces = ellipsoids(panel.scene[rows])
        mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
        each = len(faces) // int(solid.sum())
        actor = plotter.add_mesh(mesh, scalars=np.repeat(values[solid], each, axis=0), **options)
    return actor.mapper if actor else None


def ellipsoids(scene: Gaussians) -> tuple[Float[np.ndarray, "v 3"], np.ndarray]:
    """Vertices, and triangles of indices into them, of the Gaussians' surfaces at ELLIPSOID_RADIUS
    standard deviations. Raises UsageError for more than 20,000, which take
    10 times as long as their points in software OpenGL."""
    if len(scene) > 20_000:
        raise UsageError(
            f"{len(scene):,} ellipsoids are too many to draw (at most 20,000): select "
            "fewer with --selection FLAGS.npy, or raise --min-opacity"
        )
    sphere = import_pyvista().Icosphere(radius=ELLIPSOID_RADIUS, nsub=1)
    points = torch.from_numpy(np.asarray(sphere.points)).double()
    triangles = np.asarray(sphere.regular_faces)
    scene = scene.detach().to(torch.float64)
    turned = torch.einsum("nij,nj,vj->nvi", rotation_matrices(scene.quats), scene.scales, points)
    vertices = (turned + scene.means[:, None]).reshape(-1, 3).numpy()
    first = np.arange(len(scene))[:, None, None] * len(points)
    return vertices, (triangles[None] + first).reshape(-1, 3)


def _add_surroundings(plotter: Any, scene: Gaussians, around: Surroundings) -> None:
    pyvista = import_pyvista()
    if around.points is not None:
        cloud = pyvista.PolyData(around.points.detach().double().numpy())
        plotter.add_points(cloud, color=SPARSE_COLOR, point_size=2.0)
    if not around.cameras:
        return
    cameras = [each.camera for each in around.cameras]
    mesh = pyramids(cameras, frustum_length(around.cameras, scene))
    plotter.add_mesh(mesh, color=CAMERA_COLOR, line_width=1.5)


def pyramids(cameras: Sequence[Camera], length: float) -> Any:
    """Lines of pyvista: a pyramid a camera, each of len(EDGES) lines."""
    corners = np.concatenate([frustum(camera, length) for camera in cameras])
    lines = np.array(EDGES)[None] + 5 * np.arange(len(cameras))[:, None, None]
    lines = np.insert(lines.reshape(-1, 2), 0, 2, axis=1)
    return import_pyvista().PolyData(corners, lines=lines.ravel())


def _add_bar(plotter: Any, mapper: Any, shown: Attribute, look: Look) -> None:
    scale = ", log scale" if shown.log else ""
    width, height = plotter.window_size[0] / plotter.shape[1], plotter.window_size[1]
    title = wrap(f"{shown.title}{scale} ({look.colormap})", max(20, int(width / 8)))
    plotter.add_scalar_bar(
        "\n".join(title) + "\n", mapper=mapper, color="black", n_labels=5, fmt="%.3g",
        title_font_size=14, label_font_size=12, width=0.8, height=(50 + 20 * len(title)) / height,
        position_x=0.1, position_y=8 / height, vertical=False, background_color="white", fill=True,
    )  # fmt: skip


SHARE = 0.06
"""Length of a pyramid in the extent of the cameras, or of the scene where there is one camera."""


EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
"""Edges of a pyramid: its tip is corner 0, the corners of its picture are 1 to 4."""


def frustum_length(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> float:
    """The length of the pyramids along their views, world units."""
    centers = torch.stack([v.camera.center.detach() for v in viewpoints])
    extent = float((centers - centers.mean(0)).norm(dim=1).max())
    return SHARE * (extent or bounds(scene).radius)


def frustum(camera: Camera, length: float) -> Float[np.ndarray, "5 3"]:
    """The camera's center and the corners of its picture at `length` along the view, in the
    world."""
    w, h = camera.width, camera.height
    corners = torch.tensor([[0, 0], [w, 0], [w, h], [0, h]], dtype=torch.float64)
    depth = torch.full((4,), length, dtype=torch.float64)
    far = camera.unproject(corners, depth).detach()
    return torch.cat((camera.center.detach().double()[None], far)).numpy()


def outside_camera(
    scene: Gaussians, viewpoints: Sequence[Viewpoint], size: tuple[int, int]
) -> Camera:
    """A camera that shows the bulk of the scene and all cameras, from above; `size` is (width,
    height)."""
    up = up_of([v.camera for v in viewpoints])
    centers = torch.stack([v.camera.center.detach().double() for v in viewpoints])
    first = framing_camera(scene, up=up, size=size)
    middle = torch.tensor(bounds(scene).center, dtype=torch.float64)
    direction = first.center - middle
    direction = direction + 0.4 * direction.norm() * up  # a ring of cameras is seen from above it
    for step in range(40):  # 1.1^40 = 45 times as far
        camera = framing_camera(
            scene, up=up, eye=middle + direction * 1.1**step, target=middle, size=size
        )
        xy, depth = camera.project(centers)
        inside = (xy >= 0) & (xy <= torch.tensor(size))
        if bool(inside.all()) and bool((depth > 0).all()):
            return camera
    return first


NO_SURROUNDINGS, LOOK = Surroundings(), Look()
SIZE_PIXELS = (960, 720)


def draw(
    panels: Sequence[Panel], camera: Camera, look: Look, around: Surroundings = NO_SURROUNDINGS
) -> Image.Image:
    """The panels side by side, drawn off screen.

    Raises GseditError where pyvista or OpenGL is missing, UsageError as `make_plotter` does.
    """
    check_drawing()
    plotter = make_plotter(panels, camera, look, around, off_screen=True)
    try:
        return Image.fromarray(np.asarray(plotter.screenshot(return_img=True))[..., :3])
    finally:
        plotter.close()


def preview(
    scene: Gaussians,
    path: Path | str | None = None,
    *,
    after: Gaussians | None = None,
    look: Look = LOOK,
    selection: Bool[Tensor, " n"] | None = None,
    around: Surroundings = NO_SURROUNDINGS,
    camera: Camera | None = None,
    size: tuple[int, int] = SIZE_PIXELS,
    min_opacity: float = 0.1,
    titles: tuple[str, str] = ("before", "after"),
    extra: Mapping[str, np.ndarray] | None = None,
    after_extra: Mapping[str, np.ndarray] | None = None,
    overwrite: bool = False,
) -> None:
    """Show the scene as a point cloud: into a PNG at `path`, or in a window without `path`.

    With `after`, that scene beside it under the `titles`, from the same camera. Gaussians fainter
    than `min_opacity` are left out. Without a camera one is chosen by `framing_camera`, or one that
    shows the cameras of `around` too; `size` is (width, height) of one scene's picture. `extra` and
    `after_extra` hold further columns of the two scenes to color by.

    Raises UsageError where nothing is left, an attribute is unknown, the selection does not fit,
    there are too many ellipsoids, or there is no screen for a window; GseditError where pyvista or
    OpenGL is missing.
    """
    extras = extra or {}, after_extra or {}
    panels = shown_panels(scene, after, look, selection, titles, extras, min_opacity)
    shown = panels[0].scene
    if camera is None and around.cameras:
        camera = outside_camera(shown, around.cameras, size)
    elif camera is None:
        camera = framing_camera(shown, up=up_of(cameras_of(scene, size=64)), size=size)
    if path is not None:
        save_picture(draw(panels, camera, look, around), path, overwrite=overwrite)
        return
    check_screen()
    check_drawing()
    make_plotter(panels, camera, look, around, off_screen=False).show()


def shown_panels(
    scene: Gaussians,
    after: Gaussians | None,
    look: Look,
    selection: Bool[Tensor, " n"] | None,
    titles: tuple[str, str],
    extras: tuple[Mapping[str, np.ndarray], Mapping[str, np.ndarray]],
    min_opacity: float,
) -> list[Panel]:
    """The one or two scenes without what is fainter than `min_opacity`. A selection holds for the
    second scene too where that has as many Gaussians; else nothing of that is selected."""
    if selection is not None and len(selection) != len(scene):
        raise UsageError(
            f"the selection has {len(selection)} flags and the scene {len(scene)} Gaussians: it "
            "belongs to another scene"
        )
    if look.color_by == "selection" and selection is None:
        raise UsageError("there is no selection to color by: give --selection FLAGS.npy")
    panels = [Panel(scene, titles[0] if after is not None else "", selection, extras[0])]
    if after is not None:
        if selection is not None and len(after) != len(scene):
            selection = torch.zeros(len(after), dtype=torch.bool)
        panels.append(Panel(after, titles[1], selection, extras[1]))
    return [panel[solid(panel.scene, min_opacity)] for panel in panels]
