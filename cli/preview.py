"""`gsedit preview`: a quick look at a scene as a point cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .cameras import Up, check_axis, up_vector
from .console import print_message, print_result
from .options import Common, DropInvalid, Force, Scene, check_file, output, read


def preview(
    scene: Scene,
    out: Annotated[Path | None, output("PNG to write; without it a window opens.")] = None,
    up: Up = None,
    width: Annotated[int, typer.Option("--width", min=16, help="Pixels.")] = 960,
    height: Annotated[int, typer.Option("--height", min=16, help="Pixels.")] = 720,
    min_opacity: Annotated[
        float, typer.Option("--min-opacity", min=0, max=1, help="Leave out what is fainter.")
    ] = 0.1,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Show the Gaussians' centres as coloured points (pyvista): a window, or a PNG with -o.

    gsedit preview scene.ply -o scene.png
    """
    from gsedit.errors import UsageError

    check_axis(up)
    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"-o {out}: name a .png file")
        check_file(out, force)
    common.apply()

    from gsedit.viewer.preview import preview as show

    found = read(scene, drop_invalid=drop_invalid)
    axis, size = up_vector(up), (width, height)
    show(found, out, up=axis, size=size, min_opacity=min_opacity, overwrite=force)
    if out is not None:
        print_message(f"{out} shows {len(found)} Gaussians as points")
        print_result({"picture": str(out)}, str(out), as_json=common.json)
