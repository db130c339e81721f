"""`gsedit render`: pictures and animations of a scene, from its cameras or along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import ViewOptions, up_vector
from .console import print_message
from .kernel import say_kernel
from .options import (
    Common,
    DropInvalid,
    Force,
    Scene,
    check_file,
    check_folder,
    load_file,
    numerics_of,
    output,
    parse_indices,
    scene_file,
)
from .placed import Placed, place
from .render_files import write
from .render_options import (
    ARC,
    FPS,
    FRAMES,
    Kind,
    PathKind,
    PathOptions,
    PictureOptions,
    check_pictures,
    kind_of,
)
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    from rasterizer.camera import Camera
    from rasterizer.numerics import Execution, Numerics
    from rasterizer.scene import Gaussians

COUNT = 8
FOUND_VIEWS = 24
"""Views that are searched for where a path goes by them or a region is found with them."""

Views = Annotated[
    str | None,
    typer.Option(
        "--views",
        metavar="0,8,16",
        show_default=False,
        help="Numbers of the capture's views to render, from 0, or that a path goes by.",
    ),
]
Count = Annotated[
    int | None,
    typer.Option(
        "--count",
        min=1,
        help="Without --views: number of views in a folder, evenly spaced.",
        show_default=str(COUNT),
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
    """The option --kernel, a field of Execution."""
    from rasterizer.numerics import Execution

    layout = Layout("Rendering", without=("tile_size", "block", "cull"))
    return settings_of(Execution(), layout)


def render(
    scene: Scene,
    out: Annotated[
        Path,
        output("A folder for pictures, one picture (.png, .exr, .npy), or a path (.mp4, .gif)."),
    ],
    views: Views = None,
    count: Count = None,
    region: Region = None,
    prompt: Prompt = None,
    editor: EditorName = "small",
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    cameras: ViewOptions,
    path: PathOptions,
    pictures: PictureOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Render a scene: from the cameras of --data, or those of the cameras.json beside the scene, or
    else from where it looks as if it was captured; single views, or a path by these cameras.

    gsedit render scene.ply --data photos/ --views 0,8,16 --show color,depth -o frames

    gsedit render scene.ply --path turntable -o turn.mp4

    gsedit render before.ply --wipe after.ply --path orbit -o wipe.mp4
    """
    check(scene, out, views, count, region, prompt, cameras, path, pictures, force)
    common.apply()

    from gsedit.reports.frames import Animation
    from rasterizer.numerics import Execution

    execution = with_values(Execution(), values)
    gaussians, second, numerics = read_scenes(scene, pictures.wipe, drop_invalid=drop_invalid)
    say_kernel(execution)
    moving = path.path or (PathKind.turntable if kind_of(out) == "animation" else None)
    wanted = count or (COUNT if kind_of(out) == "folder" else 1)
    searched = FOUND_VIEWS if moving or region is not None else wanted
    placed = place(scene, gaussians, cameras, searched, execution)
    if region is not None:
        gaussians = tint(gaussians, region, placed, editor, prompt or "", execution)
    named = placed.named(numbers_of(placed, views, None if moving else wanted))
    if moving:
        named = follow(moving, list(named.values()), gaussians, path, cameras)
    shots = tuple(sized(camera, pictures, out) for camera in named.values())
    seen = pictures.maps, second, moving is not None, pictures.background_color()
    animation = Animation(gaussians, shots, *seen, execution, numerics)
    write(animation, list(named), out, path.fps or FPS, pictures, force, common)


def check(
    scene: Path,
    out: Path,
    views: str | None,
    count: int | None,
    region: str | None,
    prompt: str | None,
    cameras: ViewOptions,
    path: PathOptions,
    pictures: PictureOptions,
    force: bool,
) -> None:
    """Raise UsageError for what makes no sense, before a large file is read."""
    check_pictures(out, pictures, path)
    check_views(views, count, scene, cameras, path, kind_of(out))
    check_region(region, prompt, pictures)
    cameras.check()
    (check_folder if kind_of(out) == "folder" else check_file)(out, force)


def numbers_of(placed: Placed, views: str | None, wanted: int | None) -> list[int]:
    """The numbers of the views: those that are named, else `wanted` evenly spaced ones (None:
    all)."""
    from gsedit.views.dataset import evenly_spaced

    if views is not None:
        return parse_indices(views, "--views")
    total = len(placed.viewpoints)
    return evenly_spaced(total, total if wanted is None else wanted)


def read_scenes(
    scene: Path, wiped: Path | None, *, drop_invalid: bool
) -> tuple[Gaussians, Gaussians | None, tuple[Numerics, Numerics]]:
    """The scene, the second one of a wipe, and how each is rendered."""
    first = load_file(scene, drop_invalid=drop_invalid)
    second = None
    if wiped is not None:
        second = load_file(scene_file(wiped), drop_invalid=drop_invalid)
    numerics = numerics_of(first, scene), numerics_of(second, wiped)
    return first.scene, None if second is None else second.scene, numerics


def follow(
    kind: PathKind,
    cameras: Sequence[Camera],
    scene: Gaussians,
    path: PathOptions,
    options: ViewOptions,
) -> dict[str, Camera]:
    """The cameras along a path, by the names of their pictures."""
    from gsedit.views.framing import bounds
    from gsedit.views.paths import camera_path, common_point

    if kind is not PathKind.spline and common_point(cameras) is None:
        print_message(
            "the cameras look at no common point: the path goes around the middle of the scene"
        )
    along = camera_path(
        kind.value,
        cameras,
        path.frames or FRAMES,
        up=up_vector(options.up),
        elevation=path.elevation,
        arc=path.arc or ARC,
        fallback=bounds(scene),
    )
    return {f"frame_{index:04d}": camera for index, camera in enumerate(along)}


def sized(camera: Camera, pictures: PictureOptions, out: Path) -> Camera:
    """The camera at the size and zoom that were asked for; with even sides for an MP4."""
    from gsedit.views.viewpoints import framed

    if pictures.size is not None:
        camera = framed(camera, *pictures.size)
    if pictures.zoom != 1:
        camera = replace(camera, fx=camera.fx * pictures.zoom, fy=camera.fy * pictures.zoom)
    if out.suffix.lower() == ".mp4":  # cut off by a pixel
        width, height = camera.width // 2 * 2, camera.height // 2 * 2
        camera = replace(camera, width=max(2, width), height=max(2, height))
    return camera


def check_views(
    views: str | None,
    count: int | None,
    scene: Path,
    options: ViewOptions,
    path: PathOptions,
    kind: Kind,
) -> None:
    """Raise UsageError for numbers of views where there is no capture, or a number of views where
    there is one picture or a path."""
    from gsedit.errors import UsageError
    from gsedit.files.cameras import cameras_file

    recorded = options.data or (not options.placed and cameras_file(scene))
    if views is not None and not recorded:
        raise UsageError(
            "--views names views of a capture: add --data DATASET, or put its cameras.json beside "
            "the scene, or use --count"
        )
    moving = path.path is not None or kind == "animation"
    if count is not None and (moving or kind == "still"):
        raise UsageError("--count is for views in a folder: a path has --frames")
    if views is not None and len(parse_indices(views, "--views")) > 1 and kind == "still":
        raise UsageError(f"--views {views}: name a folder for several pictures")


def check_region(region: str | None, prompt: str | None, pictures: PictureOptions) -> None:
    """Raise UsageError for a region that is none, needs an instruction, or meets a wipe."""
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
    if pictures.wipe is not None:
        raise UsageError("--region tints one scene: leave out --wipe")


def tint(
    scene: Gaussians,
    region: str,
    placed: Placed,
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
        dataset=placed.dataset(scene, execution),
        editor=make_editor(editor),
        prompt=prompt,
        execution=execution,
    )
    print_message(f"region: {found}")
    return tinted(scene, found)
