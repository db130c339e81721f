"""Options of `gsedit render`: what is shown, along which path, into which files."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    import torch

    from gsedit.views.maps import MapName

Kind = Literal["folder", "still", "animation"]
STILLS, ANIMATIONS = (".png", ".exr", ".npy"), (".mp4", ".gif")
OTHERS = (
    ".jpg",
    ".jpeg",
    ".webp",
    ".tif",
    ".tiff",
    ".bmp",
    ".avi",
    ".mov",
    ".mkv",
    ".webm",
    ".m4v",
)
"""Suffixes that are no folder's name, and are not written."""
NAMES = ("color", "depth", "normals", "alpha")
"""Of gsedit.views.maps.MAPS, which imports torch; a test compares them."""
MOST_PIXELS = 1 << 26
FRAMES, FPS, ARC, CRF = 120, 30.0, 60.0, 18
"""Defaults of the options of these names, which are None: one that is given where it would change
nothing is refused."""


class PathKind(str, Enum):
    """Of gsedit.views.paths.PathKind."""

    turntable = "turntable"
    orbit = "orbit"
    spline = "spline"


class FolderFormat(str, Enum):
    """Of gsedit.reports.rendered_views.Format."""

    png = "png"
    exr = "exr"
    npy = "npy"


def path_option(name: str, help: str, **more: Any) -> Any:
    return typer.Option(name, help=help, rich_help_panel="Camera path", **more)


@dataclass(frozen=True)
class PathOptions:
    """A path of cameras instead of single views."""

    path: Annotated[
        PathKind | None,
        path_option(
            "--path",
            "turntable: a full turn around what the capture's cameras look at, which repeats "
            "seamlessly. orbit: from the middle of the side where they stand to its ends and back. "
            "spline: smoothly through at most 24 of them.",
            show_default="turntable for .mp4 and .gif, else none",
        ),
    ] = None
    frames: Annotated[
        int | None,
        path_option("--frames", "Pictures along the path.", min=1, show_default=str(FRAMES)),
    ] = None
    fps: Annotated[
        float | None,
        path_option(
            "--fps",
            "Frames a second of .mp4 and .gif.",
            min=0.1,
            max=240,
            show_default=str(FPS),
        ),
    ] = None
    arc: Annotated[
        float | None,
        path_option(
            "--arc",
            "Degrees between the ends of an orbit.",
            min=1,
            max=360,
            show_default=str(ARC),
        ),
    ] = None
    elevation: Annotated[
        float | None,
        path_option(
            "--elevation",
            "Degrees above the horizon, of turntable and orbit.",
            min=-89,
            max=89,
            show_default="the cameras' median",
        ),
    ] = None


def picture_option(name: str, help: str, **more: Any) -> Any:
    return typer.Option(name, help=help, rich_help_panel="Pictures", **more)


@dataclass(frozen=True)
class PictureOptions:
    """What is shown, and how it is written."""

    show: Annotated[
        str,
        picture_option(
            "--show",
            "Any of color, depth, normals, alpha: files of their own in a folder, channels of an "
            ".exr, side by side elsewhere. depth: along the view, scene units, where the "
            "transmittance falls to one half. normals: of the Gaussians' shortest axes; x right, y "
            "up, z towards the viewer.",
            metavar="MAPS",
        ),
    ] = "color"
    depth: Annotated[bool, picture_option("--depth", "The same as --show color,depth.")] = False
    format: Annotated[
        FolderFormat,
        picture_option(
            "--format",
            "Of the files in a folder. exr and npy hold float32: exr linear light, npy the "
            "renderer's sRGB.",
        ),
    ] = FolderFormat.png
    resolution: Annotated[
        str | None,
        picture_option(
            "--resolution",
            "Exact size of the pictures, instead of --size: they show all that the cameras do.",
            metavar="WxH",
            show_default=False,
        ),
    ] = None
    zoom: Annotated[
        float,
        picture_option(
            "--zoom", "Times the focal length: below 1 shows more, above 1 less.", min=0.05, max=50
        ),
    ] = 1.0
    background: Annotated[
        str,
        picture_option(
            "--background",
            "Colour behind the scene: a name, '#ff8800', or transparent (PNG pictures only).",
            metavar="COLOUR",
        ),
    ] = "black"
    wipe: Annotated[
        Path | None,
        picture_option(
            "--wipe",
            "A second scene, beside the first: a vertical line parts them, which moves along a "
            "path.",
            metavar="SCENE",
            show_default=False,
        ),
    ] = None
    crf: Annotated[
        int | None,
        picture_option(
            "--crf",
            "Quality of .mp4: 0 is the best and largest, 51 the worst.",
            min=0,
            max=51,
            show_default=str(CRF),
        ),
    ] = None

    @property
    def maps(self) -> tuple[MapName, ...]:
        """The names of the maps to show. Raises UsageError for another name."""
        from gsedit.errors import UsageError

        names = [*self.show.split(","), *(["depth"] if self.depth else [])]
        for name in names:
            if name not in NAMES:
                raise UsageError(f"--show {self.show}: give any of {', '.join(NAMES)}")
        return tuple(dict.fromkeys(names))  # pyright: ignore[reportReturnType]

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of --resolution. Raises UsageError."""
        from gsedit.errors import UsageError

        if self.resolution is None:
            return None
        try:
            width, height = (int(part) for part in self.resolution.lower().split("x"))
        except ValueError:
            width = height = 0
        if min(width, height) < 1 or width * height > MOST_PIXELS:
            raise UsageError(f"--resolution {self.resolution}: give two sizes, as in 1280x720")
        return width, height

    @property
    def transparent(self) -> bool:
        return self.background == "transparent"

    def background_color(self) -> torch.Tensor | None:
        """sRGB in [0, 1]; None for black. Raises UsageError for a text that is no colour."""
        from gsedit.errors import UsageError

        if self.background in ("black", "transparent"):
            return None
        import torch
        from PIL import ImageColor

        try:
            levels = ImageColor.getrgb(self.background)
        except ValueError:
            levels = ()
        if len(levels) != 3:  # no colour, or one with alpha
            raise UsageError(
                f"--background {self.background}: give a colour's name, '#rrggbb' or transparent"
            )
        return torch.tensor(levels) / 255


def kind_of(out: Path) -> Kind:
    """What -o asks for, by its suffix. Raises UsageError for a kind of file that is not written."""
    from gsedit.errors import UsageError

    suffix = out.suffix.lower()
    if suffix in OTHERS:
        raise UsageError(
            f"-o {out}: name a folder, a picture ({', '.join(STILLS)}) or an animation "
            f"({', '.join(ANIMATIONS)})"
        )
    return "still" if suffix in STILLS else "animation" if suffix in ANIMATIONS else "folder"


def check_path(path: PathOptions, kind: Kind, out: Path) -> None:
    """Raise UsageError for options of a path that would change nothing."""
    from gsedit.errors import UsageError

    given = {name for name, value in vars(path).items() if value is not None}
    taken = path.path or (PathKind.turntable if kind == "animation" else None)
    if taken is None and (unused := given & {"frames", "arc", "elevation"}):
        raise UsageError(
            f"--{min(unused)} is for a path of cameras: add --path, or name an .mp4 or a .gif"
        )
    if "arc" in given and taken != PathKind.orbit:
        raise UsageError("--arc is for --path orbit: add it, or leave --arc out")
    if "elevation" in given and taken == PathKind.spline:
        raise UsageError("--elevation is for turntable and orbit: a spline keeps to the cameras")
    if "fps" in given and kind != "animation":
        raise UsageError(f"--fps is for .mp4 and .gif, not for -o {out}")


def check_pictures(out: Path, options: PictureOptions, path: PathOptions) -> None:
    """Raise UsageError for options that do not go together, and GseditError for a missing encoder:
    before a large file is read.
    """
    from gsedit.errors import UsageError

    kind, maps, suffix = kind_of(out), options.maps, out.suffix.lower()
    _ = options.background_color(), options.size  # they raise
    if kind == "still" and path.path is not None:
        raise UsageError(f"-o {out} is one picture: name an .mp4, a .gif or a folder for --path")
    check_path(path, kind, out)
    if kind != "folder" and options.format != FolderFormat.png:
        raise UsageError(f"--format is for folders: -o {out} says it by its suffix")
    if suffix == ".npy" and len(maps) > 1:
        raise UsageError(f"-o {out} holds one map: show one, or name an .exr or a folder")
    if options.transparent:
        if kind == "animation" or suffix in (".exr", ".npy"):
            raise UsageError(f"--background transparent is for PNG pictures, not for -o {out}")
        if options.format != FolderFormat.png:
            raise UsageError("--background transparent is for PNG pictures: leave out --format")
        if "color" not in maps or (kind == "still" and len(maps) > 1):
            raise UsageError(
                "--background transparent is for colours in a PNG of their own: show color alone, "
                "or name a folder"
            )
    if options.wipe is not None:
        if maps != ("color",) or options.transparent:
            raise UsageError("--wipe shows colours: leave out --show, --depth and transparent")
        if suffix in (".exr", ".npy") or options.format != FolderFormat.png:
            raise UsageError("--wipe is written as .png, .mp4, .gif or a folder of PNG files")
    if options.crf is not None and suffix != ".mp4":
        raise UsageError(f"--crf is for .mp4, not for -o {out}: leave it out")
    if kind == "animation":
        from gsedit.files.animations import check_fps, check_video

        check_fps(out, path.fps or FPS)
        if suffix == ".mp4":
            check_video()
