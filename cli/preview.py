"""`gsedit preview`: a quick look at a scene as a point cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from .cameras import From, LookAt, Up, point, recorded_viewpoints, up_vector
from .console import print_message, print_result
from .options import Common, DropInvalid, Force, Scene, check_file, load_scene, output


def pixels(flag: str, help: str) -> Any:
    return typer.Option(flag, min=16, metavar="PIXELS", help=help)


def preview(
    scene: Scene,
    out: Annotated[Path | None, output("PNG to write; without it a window opens.")] = None,
    up: Up = None,
    look_at: LookAt = None,
    eye: From = None,
    width: Annotated[int, pixels("--width", "Width of the picture.")] = 960,
    height: Annotated[int, pixels("--height", "Height of the picture.")] = 720,
    min_opacity: Annotated[
        float,
        typer.Option("--min-opacity", min=0, max=1, help="Leave out Gaussians of lower opacity."),
    ] = 0.1,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Show the centres of the Gaussians as coloured points: in a window, or as a PNG with -o.

    Seen from the first camera of the cameras.json beside the scene, or else from around it.

    gsedit preview scene.ply -o scene.png
    """
    from gsedit.errors import UsageError

    axis, target, stand = up_vector(up), point(look_at, "--look-at"), point(eye, "--from")
    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"-o {out}: name a .png file")
        check_file(out, force)
    common.apply()

    from gsedit.viewer.preview import preview as show
    from gsedit.views.framing import framing_camera
    from gsedit.views.viewpoints import framed

    gaussians = load_scene(scene, drop_invalid=drop_invalid)
    size, camera = (width, height), None
    if target is not None or stand is not None:
        camera = framing_camera(gaussians, up=axis, eye=stand, target=target, size=size)
    elif axis is None and (recorded := recorded_viewpoints(scene, gaussians, max(size))):
        camera = framed(recorded[0].camera, width, height)
    show(
        gaussians, out, camera=camera, up=axis, size=size, min_opacity=min_opacity, overwrite=force
    )
    if out is not None:
        print_message(f"{out} shows {len(gaussians)} Gaussians as points")
        print_result({"picture": str(out)}, str(out), as_json=common.json)
