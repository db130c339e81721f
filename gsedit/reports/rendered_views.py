"""Renders of a scene as files: a picture a camera, and its depth as numbers and in colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from gsedit.files.atomic import atomic_path
from gsedit.files.pictures import as_picture, save_picture
from gsedit.reports.depth_pictures import depth_picture
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians


def write_view(
    scene: Gaussians,
    camera: Camera,
    stem: Path | str,
    *,
    depth: bool = False,
    execution: Execution = AUTO,
    overwrite: bool = False,
) -> list[Path]:
    """Render a view and write STEM.png; the files written.

    With `depth` also STEM.depth.npy (`h w` float32: median depth along the view, scene units, 0
    where nothing is) and STEM.depth.png (the same in colour). Raises UsageError where a file
    exists, unless `overwrite`.
    """
    stem = Path(stem)
    with torch.no_grad():
        rendering = render(scene, camera, median_depth=depth, execution=execution)
    picture = stem.with_name(f"{stem.name}.png")
    save_picture(as_picture(rendering.color), picture, overwrite=overwrite)
    if rendering.median_depth is None:
        return [picture]
    numbers, colors = (stem.with_name(f"{stem.name}.depth{end}") for end in (".npy", ".png"))
    with atomic_path(numbers, overwrite=overwrite) as temporary:
        np.save(temporary, rendering.median_depth.float().cpu().numpy())
    colored = depth_picture(rendering.median_depth, rendering.alpha)
    save_picture(colored, colors, overwrite=overwrite)
    return [picture, numbers, colors]
