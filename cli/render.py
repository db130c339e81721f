"""`gsedit render`: pictures and depth of a scene from its dataset's cameras, or from around it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import Up, around, check_axis
from .console import print_message, print_result
from .options import (
    Common,
    Compile,
    Data,
    DropInvalid,
    Force,
    Scene,
    Size,
    check_folder,
    output,
    read,
    whole_numbers,
)
from .progress import progress

if TYPE_CHECKING:
    from gsedit.views.dataset import Dataset
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians


def render(
    scene: Scene,
    out: Annotated[Path, output("Folder for the pictures.")],
    data: Data = None,
    views: Annotated[
        str | None,
        typer.Option(
            "--views", metavar="0,8,16", show_default=False, help="Which of the dataset's views."
        ),
    ] = None,
    count: Annotated[
        int,
        typer.Option("--count", min=1, help="Without --views: this many, evenly spaced."),
    ] = 8,
    size: Size = 256,
    up: Up = None,
    depth: Annotated[
        bool,
        typer.Option(
            "--depth",
            help="Also NAME.depth.npy (float32, scene units along the view, where half of the "
            "light is stopped; 0 where nothing is) and NAME.depth.png (the same in colour).",
        ),
    ] = False,
    compile: Compile = False,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Render a scene: a PNG per view, from a dataset's cameras or from around the scene.

    gsedit render scene.ply --data photos/ --views 0,8,16 --depth -o frames
    """
    from gsedit.errors import UsageError

    if views is not None and data is None:
        raise UsageError("--views names views of a dataset: add --data DATASET, or use --count")
    wanted = None if views is None else whole_numbers(views, "--views")
    check_axis(up)
    check_folder(out, force)
    common.apply()

    found = read(scene, drop_invalid=drop_invalid)
    cameras = place(found, data, wanted, count, size, up)
    with progress(as_json=common.json) as show:
        from time import perf_counter

        from gsedit.reports.events import Event

        began = perf_counter()
        for step, (name, camera) in enumerate(cameras.items(), 1):
            for path in draw(
                found, camera, out / name, depth=depth, compile=compile, overwrite=force
            ):
                print_result({"picture": str(path)}, str(path), as_json=common.json)
            show(Event("render", perf_counter() - began, step, len(cameras)))
    print_message(f"{len(cameras)} views are in {out}")


def place(
    scene: Gaussians,
    data: Path | None,
    views: list[int] | None,
    count: int,
    size: int,
    up: str | None,
) -> dict[str, Camera]:
    """The cameras to render from, by the name of their picture."""
    if data is None:
        return around(scene, count, size, up)
    from gsedit.files import load_dataset
    from gsedit.views.dataset import evenly_spaced

    dataset = load_dataset(data, size=size)
    chosen = evenly_spaced(len(dataset), count) if views is None else views
    return dict(named(dataset, index, data) for index in chosen)


def named(dataset: Dataset, index: int, data: Path) -> tuple[str, Camera]:
    """A view's camera, and a name that keeps its number and its photo's name."""
    from gsedit.errors import UsageError

    if not 0 <= index < len(dataset):
        raise UsageError(f"--views {index}: {data} has views 0 to {len(dataset) - 1}")
    view = dataset.views[index]
    return f"{index:03d}_{Path(view.name).stem}", view.camera


def draw(
    scene: Gaussians, camera: Camera, stem: Path, *, depth: bool, compile: bool, overwrite: bool
) -> list[Path]:
    """Write one view's picture, and its depth if wanted; the files written."""
    import numpy as np
    import torch

    from gsedit.files import atomic_path
    from gsedit.files.pictures import as_picture, save_picture
    from gsedit.reports.depth_pictures import depth_picture
    from rasterizer.numerics import Execution
    from rasterizer.render import render as rasterize

    with torch.no_grad():
        seen = rasterize(scene, camera, median_depth=depth, execution=Execution(compile=compile))
    picture = stem.with_name(f"{stem.name}.png")
    save_picture(as_picture(seen.color), picture, overwrite=overwrite)
    if seen.median_depth is None:
        return [picture]
    numbers, colors = (stem.with_name(f"{stem.name}.depth{end}") for end in (".npy", ".png"))
    with atomic_path(numbers, overwrite=overwrite) as temporary:
        np.save(temporary, seen.median_depth.float().cpu().numpy())
    save_picture(depth_picture(seen.median_depth, seen.alpha), colors, overwrite=overwrite)
    return [picture, numbers, colors]
