"""`gsedit render`: pictures and animations of a scene, from its cameras or along a path."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from gsedit.errors import UsageError
from gsedit.pictures import MAPS, Format, MapName
from gsedit.views import PathKind
from rasterizer.numerics import Execution, Numerics

from ..core.command import Settings, Values, option, settings_of, shows, with_values
from ..core.console import print_message, print_result
from ..core.kernel import say_kernel
from ..core.outputs import check_file, check_folder
from ..core.progress import counting
from ..options.cameras import ResolvedCameras, ViewOptions, resolve_cameras
from ..options.common import Reads, Scene, Writes, load_file, numerics_of, scene_file

if TYPE_CHECKING:
    import numpy as np
    import torch

    from gsedit.pictures.animations import Animation
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

Kind = Literal["folder", "still", "animation"]
STILLS, ANIMATIONS = (".png", ".exr", ".npy"), (".mp4", ".webp", ".gif")
PHOTOS = (".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
OTHERS = (*PHOTOS, ".avi", ".mov", ".mkv", ".webm", ".m4v")
"""Suffixes that are no folder's name, and are not written."""
FRAMES, FPS, ARC, CRF, COUNT = 120, 30.0, 60.0, 18, 8
"""Defaults of the options of these names, which are None: one that is given where it would change
nothing is refused."""
RENDER_SETTINGS = Settings(partial(settings_of, Execution()))
"""Options of how pictures are computed."""


@dataclass(frozen=True)
class RenderOptions(Reads, Writes):
    """Options of `gsedit render` alone."""

    out: Path = option(..., "PATH", flags="--output -o")
    """A folder for pictures, one picture (.png, .exr, .npy), or a path (.mp4, .webp, .gif)."""
    views: str | None = option(None, "0,8,16")
    """Numbers of the capture's views to render, from 0, or that a path goes by."""
    count: int | None = option(None, min=1)
    """Without --views: number of views in a folder, evenly spaced. None: 8."""
    region: str | None = option(None, "REGION")
    """Tint the region that gsedit edit would change: auto (with --prompt),
    box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, or masks."""
    prompt: str | None = option(None, "INSTRUCTION")
    """The instruction that --region auto is for."""
    editor: str = option("painter", flags=None)
    """The 2D editor that --region auto asks."""
    path: PathKind | None = option()
    """turntable: a full turn around the point that the cameras look at. orbit: from the middle of
    the cameras to both ends and back. spline: through at most 24 cameras. None: turntable for .mp4,
    .webp and .gif, else none."""
    frames: int | None = option(None, min=1)
    """Pictures along the path. None: 120."""
    fps: float | None = option(None, min=0.1, max=240)
    """Frames a second of .mp4, .webp and .gif. None: 30."""
    arc: float | None = option(None, min=1, max=360)
    """Degrees between the ends of an orbit. None: 60."""
    elevation: float | None = option(None, flags=None, min=-89, max=89)
    """Degrees above the horizon, of turntable and orbit. None: the cameras' median."""
    show: str = option("color", "MAPS")
    """Maps to show, separated by commas: color, depth (along the view, in scene units, where the
    transmittance falls to 0.5), normals (x right, y up, z towards the viewer), alpha."""
    format: Format = option("png")
    """Format of the files in a folder. exr holds linear light, npy sRGB; both are float32."""
    resolution: str | None = option(None, "WxH")
    """Exact size of the pictures, instead of --size."""
    zoom: float = option(1.0, min=0.05, max=50)
    """Times the focal length: below 1 shows more, above 1 less."""
    background: str = option("black", "COLOR")
    """Color behind the scene: a name, '#ff8800', or transparent (PNG only)."""
    wipe: Path | None = option(None, "SCENE")
    """Second scene, beside the first; the line between them moves along a path."""
    crf: int | None = option(None, flags=None, min=0, max=51)
    """Quality of .mp4: 0 is the best and largest, 51 the worst. None: 18."""

    @property
    def kind(self) -> Kind:
        """Kind of output that -o names by its suffix. Raises UsageError for others."""
        suffix = self.out.suffix.lower()
        if suffix in OTHERS:
            raise UsageError(
                f"-o {self.out}: name a folder, a picture ({', '.join(STILLS)}) or an animation "
                f"({', '.join(ANIMATIONS)})"
            )
        return "still" if suffix in STILLS else "animation" if suffix in ANIMATIONS else "folder"

    @property
    def taken(self) -> PathKind | None:
        """The path for the kind of output; None for single views."""
        return self.path or ("turntable" if self.kind == "animation" else None)

    def check_path(self) -> None:
        """Raise UsageError for options of a path that would change nothing."""
        options = ("frames", "fps", "arc", "elevation")
        given = {name for name in options if getattr(self, name) is not None}
        kind, taken, out = self.kind, self.taken, self.out
        if kind == "still" and taken:
            raise UsageError(f"-o {out} is one picture: name .mp4, .webp or a folder for --path")
        if taken is None and (unused := given & {"frames", "arc", "elevation"}):
            raise UsageError(
                f"--{min(unused)} is for a path of cameras: add --path, or name an .mp4 or .webp"
            )
        if "arc" in given and taken != "orbit":
            raise UsageError("--arc is for --path orbit: add it, or leave --arc out")
        if "elevation" in given and taken == "spline":
            raise UsageError("elevation is for turntable and orbit: a spline keeps to the cameras")
        if "fps" in given and kind != "animation":
            raise UsageError(f"--fps is for .mp4, .webp and .gif, not for -o {out}")

    @property
    def maps(self) -> tuple[MapName, ...]:
        """The names of the maps to show. Raises UsageError for another name."""
        names = self.show.split(",")
        for name in names:
            if name not in MAPS:
                raise UsageError(f"--show {self.show}: give any of {', '.join(MAPS)}")
        return tuple(dict.fromkeys(names))  # pyright: ignore[reportReturnType]

    @property
    def exact_size(self) -> tuple[int, int] | None:
        """(width, height) of --resolution. Raises UsageError."""
        if self.resolution is None:
            return None
        try:
            width, height = (int(part) for part in self.resolution.lower().split("x"))
        except ValueError:
            width = height = 0
        if min(width, height) < 1 or width * height > 1 << 26:
            raise UsageError(f"--resolution {self.resolution}: give two sizes, as in 1280x720")
        return width, height

    @property
    def transparent(self) -> bool:
        return self.background == "transparent"

    def background_color(self) -> torch.Tensor | None:
        """sRGB in [0, 1]; None for black. Raises UsageError for a text that is no color."""
        if self.background in ("black", "transparent"):
            return None
        import torch
        from PIL import ImageColor

        try:
            levels = ImageColor.getrgb(self.background)
        except ValueError:
            levels = ()
        if len(levels) != 3:  # no color, or one with alpha
            raise UsageError(
                f"--background {self.background}: give a color's name, '#rrggbb' or transparent"
            )
        return torch.tensor(levels) / 255

    def check_pictures(self) -> None:
        """Raise UsageError for options that do not go together, or not with -o."""
        kind, out, maps, suffix = self.kind, self.out, self.maps, self.out.suffix.lower()
        _ = self.background_color(), self.exact_size  # they raise
        if kind != "folder" and self.format != "png":
            raise UsageError(f"--format is for folders: -o {out} says it by its suffix")
        if suffix == ".npy" and len(maps) > 1:
            raise UsageError(f"-o {out} holds one map: show one, or name an .exr or a folder")
        in_png = kind != "animation" and suffix not in (".exr", ".npy") and self.format == "png"
        if self.transparent and not in_png:
            raise UsageError(
                f"--background transparent is for PNG pictures: leave out --format, or -o {out}"
            )
        if self.transparent and ("color" not in maps or (kind == "still" and len(maps) > 1)):
            raise UsageError(
                "--background transparent is for colors in a PNG of their own: show color alone, "
                "or name a folder"
            )
        if self.wipe is not None:
            if maps != ("color",) or self.transparent:
                raise UsageError("--wipe shows colors: leave out --show and transparent")
            if suffix in (".exr", ".npy") or self.format != "png":
                raise UsageError("--wipe is written as .png, a folder of them, .mp4, .webp or .gif")
        if self.crf is not None and suffix != ".mp4":
            raise UsageError(f"crf is for .mp4, not for -o {out}: leave it out")


@shows(
    "--output", "--data", "--views", "--size", "--resolution", "--show", "--path",
    "--frames", "--background", "--wipe", "--region", "--force",
)  # fmt: skip
def render(
    scene: Scene,
    *,
    own: RenderOptions,
    cameras: ViewOptions,
    values: Annotated[Values, RENDER_SETTINGS],
) -> None:
    """Render pictures of a scene, or an animation along a path.

    gsedit render scene.ply --data posed/ --views 0,8,16 --show color,depth -o frames

    gsedit render scene.ply --path turntable -o turn.mp4

    gsedit render before.ply --wipe after.ply --path orbit -o wipe.mp4

    The cameras come from --data, else from the cameras.json beside the scene, else from viewpoints
    that gsedit finds.
    """
    check(scene, own, cameras)

    from gsedit.pictures.animations import Animation

    kind = own.kind
    gaussians, second, numerics = read_scenes(scene, own.wipe, drop_invalid=own.drop_invalid)
    say_kernel(with_values(Execution(), values))
    moving = own.taken
    wanted = own.count or (COUNT if kind == "folder" else 1)
    searched = None if moving or own.region is not None else wanted
    resolved = resolve_cameras(scene, gaussians, cameras, searched)
    if own.region is not None:
        gaussians = tint(gaussians, own.region, resolved, own.editor, own.prompt or "")
    named = resolved.named(numbers_of(resolved, own.views, None if moving else wanted))
    if moving:
        named = follow(moving, list(named.values()), gaussians, own, cameras)
    shots = tuple(sized(camera, own) for camera in named.values())
    seen = own.maps, second, moving is not None, own.background_color()
    animation = Animation(gaussians, shots, *seen, numerics)
    write(animation, list(named), own)


def check(scene: Path, own: RenderOptions, cameras: ViewOptions) -> None:
    """Raise UsageError for what makes no sense, and GseditError for a missing encoder, before a
    large file is read."""
    kind = own.kind
    own.check_path()
    own.check_pictures()
    if kind == "animation":
        from gsedit.pictures.animations import check_format

        check_format(own.out, own.fps or FPS)
    check_views(own, scene, cameras)
    check_region(own)
    cameras.check()
    (check_folder if kind == "folder" else check_file)(own.out, own.force)


def parse_indices(text: str) -> list[int]:
    """Read whole numbers separated by commas, as in `--views 0,8,16`. Raises UsageError."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(
            f"--views {text}: give numbers separated by commas, as in 0,8,16"
        ) from None


def numbers_of(resolved: ResolvedCameras, views: str | None, wanted: int | None) -> list[int]:
    """The numbers of the views: those that are named, else `wanted` evenly spaced ones (None:
    all)."""
    from gsedit.views.dataset import evenly_spaced

    if views is not None:
        return parse_indices(views)
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
    own: RenderOptions,
    options: ViewOptions,
) -> dict[str, Camera]:
    """The cameras along a path, by the names of their pictures."""
    from gsedit.scene.framing import bounds
    from gsedit.views.paths import camera_path, common_point

    if kind != "spline" and common_point(cameras) is None:
        print_message(
            "the cameras look at no common point: the path goes around the middle of the scene"
        )
    along = camera_path(
        kind,
        cameras,
        own.frames or FRAMES,
        up=options.wish().up,
        elevation=own.elevation,
        arc=own.arc or ARC,
        fallback=bounds(scene),
    )
    return {f"frame_{index:04d}": camera for index, camera in enumerate(along)}


def sized(camera: Camera, own: RenderOptions) -> Camera:
    """The camera at the size and zoom that were asked for; with even sides for an MP4."""
    from gsedit.views.viewpoints import framed

    if own.exact_size is not None:
        camera = framed(camera, *own.exact_size)
    if own.zoom != 1:
        camera = replace(camera, fx=camera.fx * own.zoom, fy=camera.fy * own.zoom)
    if own.out.suffix.lower() == ".mp4":  # cut off by a pixel
        width, height = camera.width // 2 * 2, camera.height // 2 * 2
        camera = replace(camera, width=max(2, width), height=max(2, height))
    return camera


def check_views(own: RenderOptions, scene: Path, options: ViewOptions) -> None:
    """Raise UsageError for numbers of views where there is no capture, or a number of views where
    there is one picture or a path."""
    from gsedit.views.cameras_json import cameras_file

    views, kind = own.views, own.kind
    recorded = options.data or (not options.placed and cameras_file(scene))
    if views is not None and not recorded:
        raise UsageError(
            "--views names views of a capture: add --data DATASET, or put its cameras.json beside "
            "the scene, or use --count"
        )
    if own.count is not None and (own.taken or kind == "still"):
        raise UsageError("--count is for views in a folder: a path has --frames")
    if views is not None and len(parse_indices(views)) > 1 and kind == "still":
        raise UsageError(f"--views {views}: name a folder for several pictures")


def check_region(own: RenderOptions) -> None:
    """Raise UsageError for a region that is none, needs an instruction, or meets a wipe."""
    region, prompt = own.region, own.prompt
    if region is None:
        if prompt is not None:
            raise UsageError("--prompt is for --region auto: add it, or leave the prompt out")
        return
    from gsedit.select.where import check_region as check_text

    check_text(region)
    if region == "auto" and not (prompt or "").strip():
        raise UsageError(
            "--region auto depends on the instruction: add --prompt 'turn it into bronze'"
        )
    if own.wipe is not None:
        raise UsageError("--region tints one scene: leave out --wipe")


def tint(
    scene: Gaussians, region: str, resolved: ResolvedCameras, editor: str, prompt: str
) -> Gaussians:
    """The scene with the region tinted; what the region holds is printed."""
    from gsedit.editing.parts import editor_region
    from gsedit.paper.editors import make_editor
    from gsedit.select.finder import Finder
    from gsedit.select.region import tinted

    finder = Finder(scene, resolved.viewpoints, region)
    found = editor_region(finder, make_editor(editor), prompt)
    if found is None:
        raise UsageError(
            f"what {prompt!r} is about is known only from its edited views: gsedit edit finds it, "
            "and writes region.npy; or name the part with --region"
        )
    print_message(f"region: {found}")
    return tinted(scene, found.inside)


def write(animation: Animation, names: Sequence[str], own: RenderOptions) -> None:
    """Write an animation, one picture, or a folder, as the suffix of -o says; print what was
    written."""
    from gsedit.pictures.animations import write_loop, write_mp4

    count, out, fps = len(animation), own.out, own.fps or FPS
    with counting("render") as tell:
        if own.kind != "animation":
            for index, name in enumerate(names):
                for path in write_view(animation, index, name, own):
                    print_result({"picture": path}, str(path))
                tell(index + 1, count)
            if own.kind == "folder":
                print_message(f"{count} views are in {out}")
            return
        frames = tracked(animation, tell)
        if out.suffix.lower() == ".mp4":
            crf = CRF if own.crf is None else own.crf
            write_mp4(frames, out, fps, crf=crf, overwrite=own.force)
        else:
            write_loop(frames, out, fps, overwrite=own.force)
        record = {"animation": out, "frames": count, "fps": fps, "bytes": out.stat().st_size}
        print_result(record, str(out))
        print_message(f"{count} frames, {count / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


def tracked(animation: Animation, tell: Callable[[int, int], None]) -> Iterator[np.ndarray]:
    """Yield the frames, each told as a step when the next one is requested."""
    for step, frame in enumerate(animation.frames(), 1):
        yield frame
        tell(step, len(animation))


def write_view(animation: Animation, index: int, name: str, own: RenderOptions) -> list[Path]:
    """Write the files of one view into a folder, or its one file; return their paths."""
    from PIL import Image

    from gsedit.formats.pictures import save_picture
    from gsedit.pictures import rendered_views as views

    one = own.kind == "still"
    stem, overwrite = own.out if one else own.out / name, own.force
    if animation.wiped is not None:
        path = stem if one else stem.with_name(f"{name}.png")
        save_picture(Image.fromarray(animation.frame(index)), path, overwrite=overwrite)
        return [path]
    how = {"background": animation.background, "numerics": animation.numerics[0]}
    clear, camera = own.transparent, animation.cameras[index]
    if one:
        views.write_still(
            animation.maps(index), animation.show, stem, transparent=clear, overwrite=overwrite
        )
        return [stem]
    files = {"show": animation.show, "format": own.format, "transparent": clear}
    return views.write_view(animation.scene, camera, stem, **files, **how, overwrite=overwrite)
