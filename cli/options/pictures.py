"""Options of `gsedit render`: what is shown, along which path, into which files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gsedit.errors import UsageError

from ..core.command import option

if TYPE_CHECKING:
    import torch

    from gsedit.pictures.maps import MapName

Kind = Literal["folder", "still", "animation"]
PathKind = Literal["turntable", "orbit", "spline"]
"""Kinds of camera paths, those of gsedit.cameras.paths, which imports torch."""
FolderFormat = Literal["png", "exr", "npy"]
"""Formats of pictures, those of gsedit.pictures.rendered_views."""
STILLS, ANIMATIONS = (".png", ".exr", ".npy"), (".mp4", ".gif")
PHOTOS = (".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
OTHERS = (*PHOTOS, ".avi", ".mov", ".mkv", ".webm", ".m4v")
"""Suffixes that are no folder's name, and are not written."""
NAMES = ("color", "depth", "normals", "alpha")
"""Names of gsedit.pictures.maps.MAPS, which imports torch; a test compares them."""
MOST_PIXELS = 1 << 26
FRAMES, FPS, ARC, CRF = 120, 30.0, 60.0, 18
"""Defaults of the options of these names, which are None: one that is given where it would change
nothing is refused."""


@dataclass(frozen=True)
class PathOptions:
    """A path of cameras instead of single views."""

    path: PathKind | None = option(
        None,
        "turntable: a full turn around the point that the cameras look at. orbit: from the "
        "middle of the cameras to both ends and back. spline: through at most 24 cameras.",
        show_default="turntable for .mp4 and .gif, else none",
    )
    frames: int | None = option(None, "Pictures along the path.", min=1, show_default=str(FRAMES))
    fps: float | None = option(
        None, "Frames a second of .mp4 and .gif.", min=0.1, max=240, show_default=str(FPS)
    )
    arc: float | None = option(
        None, "Degrees between the ends of an orbit.", min=1, max=360, show_default=str(ARC)
    )
    elevation: float | None = option(
        None,
        "Degrees above the horizon, of turntable and orbit.",
        min=-89,
        max=89,
        show_default="the cameras' median",
    )


@dataclass(frozen=True)
class PictureOptions:
    """Maps to show, and how pictures are written."""

    show: str = option(
        "color",
        "Maps to show, separated by commas: color, depth (along the view, in scene units, "
        "where the transmittance falls to 0.5), normals (x right, y up, z towards the "
        "viewer), alpha.",
        "MAPS",
    )
    depth: bool = option(False, "Short for --show color,depth.")
    format: FolderFormat = option(
        "png",
        "Format of the files in a folder. exr holds linear light, npy sRGB; both are float32.",
    )
    resolution: str | None = option(None, "Exact size of the pictures, instead of --size.", "WxH")
    zoom: float = option(
        1.0, "Times the focal length: below 1 shows more, above 1 less.", min=0.05, max=50
    )
    background: str = option(
        "black", "Color behind the scene: a name, '#ff8800', or transparent (PNG only).", "COLOR"
    )
    wipe: Path | None = option(
        None, "Second scene, beside the first; the line between them moves along a path.", "SCENE"
    )
    crf: int | None = option(
        None,
        "Quality of .mp4: 0 is the best and largest, 51 the worst.",
        min=0,
        max=51,
        show_default=str(CRF),
    )

    @property
    def maps(self) -> tuple[MapName, ...]:
        """The names of the maps to show. Raises UsageError for another name."""
        names = [*self.show.split(","), *(["depth"] if self.depth else [])]
        for name in names:
            if name not in NAMES:
                raise UsageError(f"--show {self.show}: give any of {', '.join(NAMES)}")
        return tuple(dict.fromkeys(names))  # pyright: ignore[reportReturnType]

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of --resolution. Raises UsageError."""
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


def kind_of(out: Path) -> Kind:
    """Return the kind of output that -o names by its suffix. Raises UsageError for others."""
    suffix = out.suffix.lower()
    if suffix in OTHERS:
        raise UsageError(
            f"-o {out}: name a folder, a picture ({', '.join(STILLS)}) or an animation "
            f"({', '.join(ANIMATIONS)})"
        )
    return "still" if suffix in STILLS else "animation" if suffix in ANIMATIONS else "folder"


def check_path(path: PathOptions, kind: Kind, out: Path) -> None:
    """Raise UsageError for options of a path that would change nothing."""
    given = {name for name, value in vars(path).items() if value is not None}
    taken = path.path or ("turntable" if kind == "animation" else None)
    if taken is None and (unused := given & {"frames", "arc", "elevation"}):
        raise UsageError(
            f"--{min(unused)} is for a path of cameras: add --path, or name an .mp4 or a .gif"
        )
    if "arc" in given and taken != "orbit":
        raise UsageError("--arc is for --path orbit: add it, or leave --arc out")
    if "elevation" in given and taken == "spline":
        raise UsageError("--elevation is for turntable and orbit: a spline keeps to the cameras")
    if "fps" in given and kind != "animation":
        raise UsageError(f"--fps is for .mp4 and .gif, not for -o {out}")


def check_pictures(out: Path, options: PictureOptions, path: PathOptions) -> None:
    """Raise UsageError for options that do not go together, and GseditError for a missing encoder:
    before a large file is read.
    """
    kind, maps, suffix = kind_of(out), options.maps, out.suffix.lower()
    _ = options.background_color(), options.size  # they raise
    if kind == "still" and path.path is not None:
        raise UsageError(f"-o {out} is one picture: name an .mp4, a .gif or a folder for --path")
    check_path(path, kind, out)
    if kind != "folder" and options.format != "png":
        raise UsageError(f"--format is for folders: -o {out} says it by its suffix")
    if suffix == ".npy" and len(maps) > 1:
        raise UsageError(f"-o {out} holds one map: show one, or name an .exr or a folder")
    if options.transparent:
        if kind == "animation" or suffix in (".exr", ".npy"):
            raise UsageError(f"--background transparent is for PNG pictures, not for -o {out}")
        if options.format != "png":
            raise UsageError("--background transparent is for PNG pictures: leave out --format")
        if "color" not in maps or (kind == "still" and len(maps) > 1):
            raise UsageError(
                "--background transparent is for colors in a PNG of their own: show color alone, "
                "or name a folder"
            )
    if options.wipe is not None:
        if maps != ("color",) or options.transparent:
            raise UsageError("--wipe shows colors: leave out --show, --depth and transparent")
        if suffix in (".exr", ".npy") or options.format != "png":
            raise UsageError("--wipe is written as .png, .mp4, .gif or a folder of PNG files")
    if options.crf is not None and suffix != ".mp4":
        raise UsageError(f"--crf is for .mp4, not for -o {out}: leave it out")
    if kind == "animation":
        from gsedit.pictures.animations import check_format

        check_format(out, path.fps or FPS)
