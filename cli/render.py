"""`gsedit render`: pictures and depth of a scene from its capture's cameras, or from found ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import (
    ViewOptions,
    load_photos,
    load_views,
    recorded_viewpoints,
    wish_of,
)
from .console import print_message, print_result
from .options import (
    Common,
    DropInvalid,
    Force,
    Scene,
    check_folder,
    load_scene,
    output,
    parse_indices,
)
from .progress import progress
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.views.dataset import Dataset, View
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.camera import Camera
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians

Views = Annotated[
    str | None,
    typer.Option(
        "--views",
        metavar="0,8,16",
        show_default=False,
        help="Numbers of the capture's views to render, from 0.",
    ),
]
Count = Annotated[
    int,
    typer.Option("--count", min=1, help="Without --views: number of views, evenly spaced."),
]
Depth = Annotated[
    bool,
    typer.Option(
        "--depth",
        help="Also write NAME.depth.npy (float32: distance along the view, in scene units, at "
        "which the transmittance falls to one half; 0 where it does not) and NAME.depth.png (the "
        "same in colour).",
    ),
]


Region = Annotated[
    str | None,
    typer.Option(
        "--region",
        metavar="REGION",
        show_default=False,
        help="Tint what gsedit edit with this --region would change: auto (with --prompt), "
        "box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, or masks.",
    ),
]
Prompt = Annotated[
    str | None,
    typer.Option(
        "--prompt",
        metavar="INSTRUCTION",
        show_default=False,
        help="The instruction that --region auto is for.",
    ),
]
EditorName = Annotated[
    str, typer.Option("--editor", metavar="NAME", help="The 2D editor that --region auto asks.")
]


def render_settings() -> list[Setting]:
    """The option --compile, a field of Execution."""
    from rasterizer.numerics import Execution

    layout = Layout("Rendering", without=("tile_size", "block", "cull"))
    return settings_of(Execution(), layout)


def render(
    scene: Scene,
    out: Annotated[Path, output("Folder for the pictures.")],
    views: Views = None,
    count: Count = 8,
    depth: Depth = False,
    region: Region = None,
    prompt: Prompt = None,
    editor: EditorName = "small",
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    cameras: ViewOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Render a scene to one PNG per view: from the cameras of --data, or those of the cameras.json
    beside the scene, or else from where it looks as if it was captured.

    gsedit render scene.ply --data photos/ --views 0,8,16 --depth -o frames
    """
    check_views(views, scene, cameras)
    check_region(region, prompt)
    indices = None if views is None else parse_indices(views, "--views")
    cameras.check()
    check_folder(out, force)
    common.apply()

    from gsedit.reports.events import Event
    from gsedit.reports.rendered_views import write_view
    from gsedit.reports.stopwatch import Stopwatch
    from rasterizer.numerics import Execution

    execution = with_values(Execution(), values)
    gaussians = load_scene(scene, drop_invalid=drop_invalid)
    placed = place_cameras(scene, gaussians, cameras, indices, count, execution)
    if region is not None:
        dataset = load_views(scene, gaussians, cameras, execution)
        gaussians = tint(gaussians, region, dataset, editor, prompt or "", execution)
    watch = Stopwatch()
    with progress(as_json=common.json) as show:
        for step, (name, camera) in enumerate(placed.items(), 1):
            for path in write_view(
                gaussians, camera, out / name, depth=depth, execution=execution, overwrite=force
            ):
                print_result({"picture": path}, str(path), as_json=common.json)
            show(Event("render", watch.seconds, step, len(placed)))
    print_message(f"{len(placed)} views are in {out}")


def check_views(views: str | None, scene: Path, options: ViewOptions) -> None:
    """Raise UsageError for numbers of views where there is no capture."""
    from gsedit.errors import UsageError
    from gsedit.files.cameras import cameras_file

    recorded = options.data or (not options.placed and cameras_file(scene))
    if views is not None and not recorded:
        raise UsageError(
            "--views names views of a capture: add --data DATASET, or put its cameras.json beside "
            "the scene, or use --count"
        )


def check_region(region: str | None, prompt: str | None) -> None:
    """Raise UsageError for a region that is none, or that needs an instruction."""
    from gsedit.errors import UsageError
    from gsedit.regions.parse import parse_region

    if region is None:
        if prompt is not None:
            raise UsageError("--prompt is for --region auto: add it, or leave the prompt out")
        return
    parse_region(region)
    if region == "auto" and not (prompt or "").strip():
        raise UsageError(
            "--region auto depends on the instruction: add --prompt 'turn it into bronze'"
        )


def tint(
    scene: Gaussians,
    region: str,
    dataset: Dataset,
    editor: str,
    prompt: str,
    execution: Execution,
) -> Gaussians:
    """The scene with the region tinted; what the region holds is printed."""
    from gsedit.edit import find_region
    from gsedit.editors import make_editor
    from gsedit.regions.region import tinted

    found = find_region(
        scene,
        region,
        dataset=dataset,
        editor=make_editor(editor),
        prompt=prompt,
        execution=execution,
    )
    print_message(f"region: {found}")
    return tinted(scene, found)


def place_cameras(
    path: Path,
    scene: Gaussians,
    options: ViewOptions,
    indices: list[int] | None,
    count: int,
    execution: Execution,
) -> dict[str, Camera]:
    """The cameras to render from, by the name of their picture: of the photos, or recorded beside
    the scene file, at `indices`, or `count` of them; else `count` found ones.
    """
    from gsedit.views.choose import find_views, view_names
    from gsedit.views.dataset import evenly_spaced

    if options.data is not None:
        views = load_photos(options.data, options.size, path).views
    else:
        views = () if options.placed else recorded_viewpoints(path, scene, options.size)
    if views:
        chosen = evenly_spaced(len(views), count) if indices is None else indices
        return dict(named_camera(views, index) for index in chosen)
    print_message("views are searched for in the scene; a cameras.json beside it saves this")
    found = find_views(scene, count, options.size, wish=wish_of(options), execution=execution)
    return dict(zip(view_names(len(found)), found))


def named_camera(views: Sequence[View | Viewpoint], index: int) -> tuple[str, Camera]:
    """A view's name, of its number and its photo's name, and its camera. Raises UsageError."""
    from gsedit.errors import UsageError

    if not 0 <= index < len(views):
        raise UsageError(f"--views {index}: there are views 0 to {len(views) - 1}")
    view = views[index]
    return f"{index:03d}_{Path(view.name).stem}", view.camera
