"""A quick look at a scene as a point cloud (pyvista): a window, or a picture drawn off screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.formats.pictures import save_picture
from gsedit.pictures.viewer.drawing import Look, Panel, Surroundings, make_plotter
from gsedit.pictures.viewer.frustums import outside_camera
from gsedit.pictures.viewer.libraries import check_drawing, has_screen
from gsedit.scene.framing import framing_camera, guess_up
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

NO_SURROUNDINGS = Surroundings()
SIZE_PIXELS = (960, 720)


def snapshot(
    scene: Gaussians,
    camera: Camera,
    *,
    after: Gaussians | None = None,
    look: Look | None = None,
    selection: Bool[Tensor, " n"] | None = None,
    around: Surroundings = NO_SURROUNDINGS,
    point_size: float | None = None,
) -> Image.Image:
    """The scene's centers as points as `camera` sees them, drawn off screen; with `after`, that
    scene beside it.

    Raises GseditError where pyvista or OpenGL is missing, UsageError as `preview` does.
    """
    look = look or Look(point_size=point_size)
    panels = [Panel(scene, selection=selection)]
    if after is not None:
        panels = [Panel(scene, "before", selection), Panel(after, "after")]
    return draw(panels, camera, look, around)


def draw(
    panels: Sequence[Panel], camera: Camera, look: Look, around: Surroundings = NO_SURROUNDINGS
) -> Image.Image:
    """The panels side by side, drawn off screen. Raises as `snapshot`."""
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
    look: Look | None = None,
    selection: Bool[Tensor, " n"] | None = None,
    around: Surroundings = NO_SURROUNDINGS,
    camera: Camera | None = None,
    up: Float[Tensor, "3"] | None = None,
    size: tuple[int, int] = SIZE_PIXELS,
    min_opacity: float = 0.1,
    point_size: float | None = None,
    titles: tuple[str, str] = ("before", "after"),
    extra: Mapping[str, np.ndarray] | None = None,
    after_extra: Mapping[str, np.ndarray] | None = None,
    overwrite: bool = False,
) -> None:
    """Show the scene as a point cloud: into a PNG at `path`, or in a window without `path`.

    With `after`, that scene beside it under the `titles`, from the same camera. Gaussians fainter
    than `min_opacity` are left out. Without a camera one is chosen by `framing_camera(up=, size=)`,
    or one that shows the cameras of `around` too; `size` is (width, height) of one scene's picture
    and `point_size` is in pixels. `extra` and `after_extra` hold further columns of
    the two scenes to color by.

    Raises UsageError where nothing is left, an attribute is unknown, the selection does not fit,
    there are too many ellipsoids, or there is no screen for a window; GseditError where pyvista or
    OpenGL is missing.
    """
    look = look or Look(point_size=point_size)
    extras = extra or {}, after_extra or {}
    panels = shown_panels(scene, after, look, selection, titles, extras, min_opacity)
    solid = panels[0].scene
    if camera is None and around.cameras:
        camera = outside_camera(solid, around.cameras, size)
    elif camera is None:
        up = guess_up(scene) if up is None else up
        camera = framing_camera(solid, up=up, size=size)
    if path is not None:
        save_picture(draw(panels, camera, look, around), path, overwrite=overwrite)
        return
    if not has_screen():
        raise UsageError("there is no screen to open a window on: give -o picture.png")
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
    second scene too where that has as many Gaussians; else nothing of that is selected.
    """
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
    solid = [panel[panel.scene.opacities >= min_opacity] for panel in panels]
    if not all(len(panel.scene) for panel in solid):
        raise UsageError(f"no Gaussian has an opacity of {min_opacity} or more: lower min_opacity")
    return solid
