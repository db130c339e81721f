"""`gsedit render`: pictures and animations of a scene, from its cameras or along a path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from .cameras import ViewOptions, up_vector
from .console import print_message, print_result
from .options import (
    Common,
    DropInvalid,
    Force,
    Scene,
    check_file,
    check_folder,
    load_scene,
    output,
    parse_indices,
    scene_file,
)
from .placed import place
from .progress import Show, progress
from .render_options import Kind, PathKind, PathOptions, PictureOptions, check_pictures, kind_of
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.reports.frames import Animation
    from gsedit.views.dataset import Dataset
    from rasterizer.camera import Camera
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians

Item = TypeVar("Item")
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
    """The option --compile, a field of Execution."""
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
    kind = kind_of(out)
    check_pictures(out, pictures, path)
    check_views(views, count, scene, cameras, path, kind)
    check_region(region, prompt, pictures)
    indices = None if views is None else parse_indices(views, "--views")
    cameras.check()
    (check_folder if kind == "folder" else check_file)(out, force)
    common.apply()

    from gsedit.reports.frames import Animation
    from gsedit.views.dataset import evenly_spaced
    from rasterizer.numerics import Execution

    execution = with_values(Execution(), values)
    gaussians = load_scene(scene, drop_invalid=drop_invalid)
    moving = path.path or (PathKind.turntable if kind == "animation" else None)
    wanted = count or (COUNT if kind == "folder" else 1)
    searched = FOUND_VIEWS if moving or region is not None else wanted
    placed = place(scene, gaussians, cameras, searched, execution)
    if region is not None:
        dataset = placed.dataset(gaussians, execution)
        gaussians = tint(gaussians, region, dataset, editor, prompt or "", execution)
    if indices is None:
        total = len(placed.viewpoints)
        indices = evenly_spaced(total, total if moving else wanted)
    named = placed.named(indices)
    if moving:
        named = follow(moving, list(named.values()), gaussians, path, cameras)
    animation = Animation(
        gaussians,
        tuple(sized(camera, pictures, out) for camera in named.values()),
        pictures.maps,
        read_wiped(pictures, drop_invalid=drop_invalid),
        moving is not None,
        pictures.background_color(),
        execution,
    )
    write(animation, list(named), out, path.fps, pictures, force, common)


def write(
    animation: Animation,
    names: Sequence[str],
    out: Path,
    fps: float,
    pictures: PictureOptions,
    force: bool,
    common: Common,
) -> None:
    """Write an animation, one picture, or a folder, as the suffix of `out` says; print what was
    written."""
    from gsedit.files.animations import write_gif, write_mp4

    count, as_json = len(animation), common.json
    with progress(as_json=as_json) as show:
        if kind_of(out) == "folder":
            for index in tracked(range(count), count, show):
                stem = out / names[index]
                for path in write_files(animation, index, stem, pictures, force):
                    print_result({"picture": path}, str(path), as_json=as_json)
            print_message(f"{count} views are in {out}")
        elif kind_of(out) == "still":
            write_one(animation, out, pictures, force)
            print_result({"picture": out}, str(out), as_json=as_json)
        else:
            frames = tracked(animation.frames(), count, show)
            if out.suffix.lower() == ".gif":
                write_gif(frames, out, fps, overwrite=force)
            else:
                write_mp4(frames, out, fps, crf=pictures.crf, overwrite=force)
            record = {"animation": out, "frames": count, "fps": fps, "bytes": out.stat().st_size}
            print_result(record, str(out), as_json=as_json)
            print_message(f"{count} frames, {count / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


def tracked(items: Iterable[Item], count: int, show: Show) -> Iterator[Item]:
    """The items, each shown as a step when the next one is asked for."""
    from gsedit.reports.events import Event
    from gsedit.reports.stopwatch import Stopwatch

    watch = Stopwatch()
    for step, item in enumerate(items, 1):
        yield item
        show(Event("render", watch.seconds, step, count))


def write_files(
    animation: Animation, index: int, stem: Path, pictures: PictureOptions, force: bool
) -> list[Path]:
    """Write the files of one view into a folder; their paths."""
    from gsedit.reports.rendered_views import save_frame, write_view

    if animation.wiped is not None:
        path = stem.with_name(f"{stem.name}.png")
        save_frame(animation.frame(index), path, overwrite=force)
        return [path]
    return write_view(
        animation.scene,
        animation.cameras[index],
        stem,
        show=animation.show,
        format=pictures.format.value,
        background=animation.background,
        transparent=pictures.transparent,
        execution=animation.execution,
        overwrite=force,
    )


def write_one(animation: Animation, out: Path, pictures: PictureOptions, force: bool) -> None:
    """Write the first view into one file."""
    from gsedit.reports.rendered_views import save_frame, write_still
    from gsedit.views.maps import render_maps

    if animation.wiped is not None:
        save_frame(animation.frame(0), out, overwrite=force)
        return
    maps = render_maps(
        animation.scene,
        animation.cameras[0],
        animation.show,
        background=animation.background,
        execution=animation.execution,
    )
    write_still(maps, animation.show, out, transparent=pictures.transparent, overwrite=force)


def read_wiped(pictures: PictureOptions, *, drop_invalid: bool) -> Gaussians | None:
    """The second scene of a wipe."""
    if pictures.wipe is None:
        return None
    return load_scene(scene_file(pictures.wipe), drop_invalid=drop_invalid)


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
        path.frames,
        up=up_vector(options.up),
        elevation=path.elevation,
        arc=path.arc,
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
    if kind == "still" and views is not None and len(parse_indices(views, "--views")) > 1:
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
