"""`gsedit render`: pictures and animations of a scene, from its cameras or along a path."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError
from rasterizer.numerics import Execution, Numerics

from ..core.command import option, output, shows
from ..core.console import print_message, print_result
from ..core.kernel import say_kernel
from ..core.outputs import check_file, check_folder
from ..core.progress import counting
from ..options.cameras import ResolvedCameras, ViewOptions, resolve_cameras
from ..options.common import (
    Common,
    DropInvalid,
    Force,
    Scene,
    load_file,
    numerics_of,
    scene_file,
)
from ..options.numbers import parse_indices
from ..options.pictures import (
    ARC,
    CRF,
    FPS,
    FRAMES,
    PathKind,
    PathOptions,
    PictureOptions,
    check_pictures,
    kind_of,
)
from ..options.settings import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    import numpy as np

    from gsedit.pictures.frames import Animation
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

COUNT = 8


def render_settings() -> list[Setting]:
    """The option --kernel, a field of Execution."""
    layout = Layout("Rendering", without=("tile_size", "block", "cull"))
    return settings_of(Execution(), layout)


@dataclass(frozen=True)
class RenderOptions:
    """Options of `gsedit render` alone."""

    out: Path = output(
        ..., "A folder for pictures, one picture (.png, .exr, .npy), or a path (.mp4, .gif)."
    )
    views: str | None = option(
        None, "Numbers of the capture's views to render, from 0, or that a path goes by.", "0,8,16"
    )
    count: int | None = option(
        None,
        "Without --views: number of views in a folder, evenly spaced.",
        min=1,
        show_default=str(COUNT),
    )
    region: str | None = option(
        None,
        "Tint the region that gsedit edit would change: auto (with --prompt), "
        "box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, or masks.",
        "REGION",
    )
    prompt: str | None = option(None, "The instruction that --region auto is for.", "INSTRUCTION")
    editor: str = option("small", "The 2D editor that --region auto asks.", "NAME")


@shows(
    "--output", "--data", "--views", "--size", "--resolution", "--show", "--path",
    "--frames", "--background", "--wipe", "--region", "--force",
)  # fmt: skip
def render(
    scene: Scene,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    own: RenderOptions,
    cameras: ViewOptions,
    path: PathOptions,
    pictures: PictureOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Render pictures of a scene, or an animation along a path.

    gsedit render scene.ply --data photos/ --views 0,8,16 --show color,depth -o frames

    gsedit render scene.ply --path turntable -o turn.mp4

    gsedit render before.ply --wipe after.ply --path orbit -o wipe.mp4

    The cameras come from --data, else from the cameras.json beside the scene, else from viewpoints
    that gsedit finds.
    """
    check(scene, own, cameras, path, pictures, force)
    common.apply()

    from gsedit.cameras.around import FOUND_VIEWS
    from gsedit.pictures.frames import Animation

    execution = with_values(Execution(), values)
    gaussians, second, numerics = read_scenes(scene, pictures.wipe, drop_invalid=drop_invalid)
    say_kernel(execution)
    moving = path.path or ("turntable" if kind_of(own.out) == "animation" else None)
    wanted = own.count or (COUNT if kind_of(own.out) == "folder" else 1)
    searched = FOUND_VIEWS if moving or own.region is not None else wanted
    resolved = resolve_cameras(scene, gaussians, cameras, searched, execution)
    if own.region is not None:
        gaussians = tint(gaussians, own.region, resolved, own.editor, own.prompt or "", execution)
    named = resolved.named(numbers_of(resolved, own.views, None if moving else wanted))
    if moving:
        named = follow(moving, list(named.values()), gaussians, path, cameras)
    shots = tuple(sized(camera, pictures, own.out) for camera in named.values())
    seen = pictures.maps, second, moving is not None, pictures.background_color()
    animation = Animation(gaussians, shots, *seen, execution, numerics)
    write(animation, list(named), own.out, path.fps or FPS, pictures, force, common)


def check(
    scene: Path,
    own: RenderOptions,
    cameras: ViewOptions,
    path: PathOptions,
    pictures: PictureOptions,
    force: bool,
) -> None:
    """Raise UsageError for what makes no sense, before a large file is read."""
    check_pictures(own.out, pictures, path)
    check_views(own, scene, cameras, path)
    check_region(own.region, own.prompt, pictures)
    cameras.check()
    (check_folder if kind_of(own.out) == "folder" else check_file)(own.out, force)


def numbers_of(resolved: ResolvedCameras, views: str | None, wanted: int | None) -> list[int]:
    """The numbers of the views: those that are named, else `wanted` evenly spaced ones (None:
    all)."""
    from gsedit.datasets.dataset import evenly_spaced

    if views is not None:
        return parse_indices(views, "--views")
    total = len(resolved.viewpoints)
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
    from gsedit.cameras.paths import camera_path, common_point
    from gsedit.scene.framing import bounds

    if kind != "spline" and common_point(cameras) is None:
        print_message(
            "the cameras look at no common point: the path goes around the middle of the scene"
        )
    along = camera_path(
        kind,
        cameras,
        path.frames or FRAMES,
        up=options.wish().up,
        elevation=path.elevation,
        arc=path.arc or ARC,
        fallback=bounds(scene),
    )
    return {f"frame_{index:04d}": camera for index, camera in enumerate(along)}


def sized(camera: Camera, pictures: PictureOptions, out: Path) -> Camera:
    """The camera at the size and zoom that were asked for; with even sides for an MP4."""
    from gsedit.datasets.viewpoints import framed

    if pictures.size is not None:
        camera = framed(camera, *pictures.size)
    if pictures.zoom != 1:
        camera = replace(camera, fx=camera.fx * pictures.zoom, fy=camera.fy * pictures.zoom)
    if out.suffix.lower() == ".mp4":  # cut off by a pixel
        width, height = camera.width // 2 * 2, camera.height // 2 * 2
        camera = replace(camera, width=max(2, width), height=max(2, height))
    return camera


def check_views(own: RenderOptions, scene: Path, options: ViewOptions, path: PathOptions) -> None:
    """Raise UsageError for numbers of views where there is no capture, or a number of views where
    there is one picture or a path."""
    from gsedit.datasets.cameras_json import cameras_file

    views, kind = own.views, kind_of(own.out)
    recorded = options.data or (not options.placed and cameras_file(scene))
    if views is not None and not recorded:
        raise UsageError(
            "--views names views of a capture: add --data DATASET, or put its cameras.json beside "
            "the scene, or use --count"
        )
    moving = path.path is not None or kind == "animation"
    if own.count is not None and (moving or kind == "still"):
        raise UsageError("--count is for views in a folder: a path has --frames")
    if views is not None and len(parse_indices(views, "--views")) > 1 and kind == "still":
        raise UsageError(f"--views {views}: name a folder for several pictures")


def check_region(region: str | None, prompt: str | None, pictures: PictureOptions) -> None:
    """Raise UsageError for a region that is none, needs an instruction, or meets a wipe."""
    if region is None:
        if prompt is not None:
            raise UsageError("--prompt is for --region auto: add it, or leave the prompt out")
        return
    from gsedit.select.questions import check_region as check_text

    check_text(region)
    if region == "auto" and not (prompt or "").strip():
        raise UsageError(
            "--region auto depends on the instruction: add --prompt 'turn it into bronze'"
        )
    if pictures.wipe is not None:
        raise UsageError("--region tints one scene: leave out --wipe")


def tint(
    scene: Gaussians,
    region: str,
    resolved: ResolvedCameras,
    editor: str,
    prompt: str,
    execution: Execution,
) -> Gaussians:
    """The scene with the region tinted; what the region holds is printed."""
    from gsedit.editing.parts import drawn_region
    from gsedit.editors import make_editor
    from gsedit.select.finder import Finder
    from gsedit.select.region import tinted

    finder = Finder(scene, resolved.viewpoints, region, execution=execution)
    found = drawn_region(finder, make_editor(editor), prompt)
    if found is None:
        raise UsageError(
            f"what {prompt!r} is about is known only from its edited views: gsedit edit finds it, "
            "and writes region.npy; or name the part with --region"
        )
    print_message(f"region: {found}")
    return tinted(scene, found)


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
    from gsedit.pictures.animations import write_gif, write_mp4

    count, as_json = len(animation), common.json
    with counting("render", as_json=as_json) as tell:
        if kind_of(out) == "folder":
            for index, name in enumerate(names):
                for path in write_files(animation, index, out / name, pictures, force):
                    print_result({"picture": path}, str(path), as_json=as_json)
                tell(index + 1, count)
            print_message(f"{count} views are in {out}")
        elif kind_of(out) == "still":
            write_one(animation, out, pictures, force)
            print_result({"picture": out}, str(out), as_json=as_json)
        else:
            frames = tracked(animation, tell)
            if out.suffix.lower() == ".gif":
                write_gif(frames, out, fps, overwrite=force)
            else:
                crf = CRF if pictures.crf is None else pictures.crf
                write_mp4(frames, out, fps, crf=crf, overwrite=force)
            record = {"animation": out, "frames": count, "fps": fps, "bytes": out.stat().st_size}
            print_result(record, str(out), as_json=as_json)
            print_message(f"{count} frames, {count / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


def tracked(animation: Animation, tell: Callable[[int, int], None]) -> Iterator[np.ndarray]:
    """Yield the frames, each told as a step when the next one is requested."""
    for step, frame in enumerate(animation.frames(), 1):
        yield frame
        tell(step, len(animation))


def write_files(
    animation: Animation, index: int, stem: Path, pictures: PictureOptions, force: bool
) -> list[Path]:
    """Write the files of one view into a folder; their paths."""
    from PIL import Image

    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.rendered_views import write_view

    if animation.wiped is not None:
        path = stem.with_name(f"{stem.name}.png")
        save_picture(Image.fromarray(animation.frame(index)), path, overwrite=force)
        return [path]
    return write_view(
        animation.scene,
        animation.cameras[index],
        stem,
        show=animation.show,
        format=pictures.format,
        background=animation.background,
        transparent=pictures.transparent,
        numerics=animation.numerics[0],
        execution=animation.execution,
        overwrite=force,
    )


def write_one(animation: Animation, out: Path, pictures: PictureOptions, force: bool) -> None:
    """Write the first view into one file."""
    from PIL import Image

    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.rendered_views import write_still

    if animation.wiped is not None:
        save_picture(Image.fromarray(animation.frame(0)), out, overwrite=force)
        return
    maps = animation.maps(0)
    write_still(maps, animation.show, out, transparent=pictures.transparent, overwrite=force)
