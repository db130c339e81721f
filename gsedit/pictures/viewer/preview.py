"""A quick look at a scene as a point cloud (pyvista): a window, or a picture drawn off screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool
from PIL import Image
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.formats.pictures import save_picture
from gsedit.pictures.viewer.drawing import Look, Panel, Surroundings, make_plotter
from gsedit.pictures.viewer.frustums import outside_camera
from gsedit.pictures.viewer.libraries import check_drawing, check_screen
from gsedit.pictures.viewer.point_clouds import solid
from gsedit.scene.framing import framing_camera, guess_up
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

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
        camera = framing_camera(shown, up=guess_up(scene), size=size)
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
    return [panel[solid(panel.scene, min_opacity)] for panel in panels]
