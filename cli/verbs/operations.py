"""Verbs that change the Gaussians of a scene and leave them where they are, by the operation that
each returns: convert, filter, clean, decimate, merge, recolor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gsedit.errors import UsageError

from ..chain import Target
from ..core.command import argument, option, shows
from ..core.console import print_message
from ..core.outputs import check_file
from ..core.process import Output
from ..options.cameras import ViewOptions, known_cameras
from ..options.common import FileOptions, scene_file
from ..options.selection import SelectionOptions, need_selection

if TYPE_CHECKING:
    from gsedit.toolkit.clean import Clean, Repair
    from gsedit.toolkit.decimate import Decimate
    from gsedit.toolkit.defects import Limits
    from gsedit.toolkit.filter import Filter
    from gsedit.toolkit.grade import Grade
    from gsedit.toolkit.merge import Merge
    from gsedit.toolkit.operation import Operation
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

Out = Annotated[
    Path | None,
    argument("OUT", "Scene to write; its suffix is the format. May be given as -o OUT."),
]
Amount = Annotated[str, argument("AMOUNT", "Share to keep, as 50%, or number, as 200000.")]
Others = Annotated[list[Path], argument("OTHER...", "Scenes to add, in any format.")]


@dataclass(frozen=True)
class ConvertOptions:
    """Options of `gsedit convert` alone."""

    order: str | None = option(None, "morton|importance")
    """Sort the rows. morton: neighbors together. importance: largest opacity times projected area
    first."""
    degree: int | None = option(None, "N", flags="--sh-degree", min=0, max=4)
    """Drop the bands of spherical harmonics above this degree: a smaller file, less gloss."""
    undo_dataparser: Path | None = option(None, "JSON")
    """Bring a scene that nerfstudio exported back into the frame of its photos: its
    dataparser_transforms.json."""


def convert(target: Out = None, *, own: ConvertOptions) -> list[Any]:
    """Write a scene in another format, order or SH degree.

    The suffix of OUT is the format. The command prints what that format cannot hold. A mesh or a
    point cloud becomes Gaussians. SCENE may also be the checkpoint of an interrupted edit or fit.

    gsedit convert scene.ply scene.spz

    gsedit convert scene.ply --order morton --sh-degree 1 -o small.ply

    gsedit convert out/bronze so_far.ply
    """
    steps: list[Any] = []
    if own.undo_dataparser is not None:
        from gsedit.toolkit.transform import transform_of
        from gsedit.views.export_frame import NAME, read_dataparser

        steps += [transform_of(read_dataparser(own.undo_dataparser).inverse), Target(target, NAME)]
    else:
        steps.append(Target(target))
    if own.degree is not None:
        from gsedit.toolkit.reduce_sh import ReduceSH

        steps.append(ReduceSH(own.degree))
    if own.order is not None:
        from gsedit.toolkit.decimate import Order

        steps.append(Order(own.order))
    return steps


def filter_(*, selection: SelectionOptions) -> Filter:
    """Keep the selected Gaussians and remove the others.

    gsedit filter scene.ply --where "opacity > 0.1 and size < 0.5" -o small.ply

    gsedit filter scene.ply --where "box(-1,-1,-inf, 1,1,inf)" -o inside.ply

    gsedit filter bear.ply --region auto --data posed/ -o bear_alone.ply

    A size is in units of the scene, an opacity and a color from 0 to 1.
    """
    chosen = need_selection(selection, "filter")

    from gsedit.toolkit.filter import Filter

    return Filter(selection=chosen)


@dataclass(frozen=True)
class CleanOptions:
    """Reasons to remove a Gaussian, and their thresholds."""

    invisible: bool = option(True)
    """Gaussians that every renderer skips: least_opacity."""
    giants: bool = option(True)
    """Gaussians larger than the whole scene: giant_size."""
    floaters: bool = option(True)
    """Gaussians far from all others: floater_distance."""
    needles: bool = option(True)
    """Long, thin streaks that end in the open: needle_ratio."""
    duplicates: bool = option(True)
    """Rows equal to an earlier one."""
    unseen: bool = option(True)
    """Gaussians that none of the capture's cameras sees: those of --data or of the cameras.json
    beside the scene; without cameras nothing."""
    least_opacity: float = option(1 / 255, flags=None, min=0)
    """Invisible: of less opacity than this (1/255)."""
    giant_size: float = option(1.0, flags=None, min=0)
    """Giants: of a longest standard deviation above so many times the scene's radius."""
    floater_distance: float = option(5.0, flags=None, min=0)
    """Floaters: whose 8th neighbor is so many times as far as is usual around them."""
    needle_ratio: float = option(5.0, flags=None, min=0)
    """Needles: of a longer longest to middle axis than this."""
    mark: bool = option(False)
    """Remove nothing: write the reason's number into the column defect."""
    reasons: Path | None = option(None, "FILE.npy")
    """Also write the number of every row's reason, 0 for what is kept; with --dry-run too."""
    repair: bool = option(False)
    """Only mend Gaussians with NaN, Inf or a rotation of length 0, and remove those that cannot be
    mended."""

    def limits(self) -> Limits:
        """The thresholds of the laws that are asked. Raises UsageError."""
        from gsedit.toolkit.defects import Limits

        return Limits(
            invisible=self.least_opacity if self.invisible else None,
            giant=self.giant_size if self.giants else None,
            floater=self.floater_distance if self.floaters else None,
            needle=self.needle_ratio if self.needles else None,
            duplicates=self.duplicates,
        )


@shows(
    "--where", "--region", "--data", "--repair", "--mark", "--reasons", "--output", "--force",
    "--dry-run",
)  # fmt: skip
def clean(*, options: CleanOptions, selection: SelectionOptions, output: Output) -> Clean | Repair:
    """Remove floaters, needles and giants, or repair invalid rows.

    gsedit clean scene.ply -o cleaned.ply

    gsedit clean broken.ply --repair -o scene.ply

    The command prints how many Gaussians it removes for each reason. --no-floaters, --no-needles
    and so on switch a reason off. docs/howto/clean.md explains each reason; gsedit list settings
    clean lists the thresholds, as in --set giant_size=2.
    """
    if options.repair:
        return repair_alone(options, selection)

    from gsedit.toolkit.clean import Clean

    limits, reasons = options.limits(), options.reasons
    check_file(reasons, output.force)
    some = selection.selection() if selection.given else None
    cameras = partial(capture_cameras, selection.data) if options.unseen else None
    return Clean(limits, cameras, some, options.mark, reasons, output.force)


def repair_alone(options: CleanOptions, selection: SelectionOptions) -> Repair:
    """Return the repair of a scene. Raises UsageError for options that it does not have."""
    from gsedit.toolkit.clean import Repair

    if options != CleanOptions(repair=True) or selection.given:
        raise UsageError(
            "--repair only mends: leave out the other options, or chain two commands: gsedit clean "
            "SCENE --repair then clean -o OUT"
        )
    return Repair()


def capture_cameras(data: Path | None, scene: Gaussians, path: Path | None) -> Sequence[Camera]:
    """The cameras of --data, or else of the cameras.json beside the scene file."""
    from gsedit.toolkit.clean import SIZE_PIXELS

    known = known_cameras(path, scene, ViewOptions(data, size=SIZE_PIXELS))
    if known is None:
        print_message("no cameras are known (--data): what none saw is not looked for")
        return []
    return [viewpoint.camera for viewpoint in known.viewpoints]


@dataclass(frozen=True)
class DecimateOptions:
    """Options of `gsedit decimate` alone."""

    method: str = option("merge", "merge|importance|random")
    """merge: join neighbors. importance: keep the largest opacity times area. random: keep any."""
    measure: bool = option(True)
    """Measure how much pictures change, in dB."""
    cameras: Path | None = option(None, "CAMERAS.JSON")
    """Cameras to measure from. None: an orbit."""


def decimate(amount: Amount, *, own: DecimateOptions) -> Decimate:
    """Reduce the number of Gaussians.

    gsedit decimate scene.ply 50% -o half.ply
    """
    kept = amount_of(amount)
    from gsedit.toolkit.decimate import Decimate

    views = None
    if own.cameras is not None:
        from gsedit.views.cameras_json import read_cameras

        views = [viewpoint.camera for viewpoint in read_cameras(own.cameras)]
    return Decimate(**kept, method=own.method, measure=own.measure, views=views)


def amount_of(text: str) -> dict[str, Any]:
    """Read 50% as a share and 200000 as a count. Raises UsageError."""
    try:
        if text.endswith("%"):
            return {"share": float(text[:-1]) / 100}
        return {"count": int(text.replace(",", ""))}
    except ValueError:
        raise UsageError(f"{text}: give a share, as 50%, or a number of Gaussians") from None


def merge(others: Others, *, files: FileOptions, output: Output) -> Merge:
    """Join several scenes into one file.

    gsedit merge room.ply chair.spz -o both.ply

    Rows keep their order. The result has the highest SH degree and all columns.
    """
    from gsedit.formats.files import open_scene
    from gsedit.toolkit.merge import Merge

    sources = tuple(open_scene(scene_file(each), files.read()) for each in others)
    return Merge(sources, output.drop_invalid)


@dataclass(frozen=True)
class GradeOptions:
    """The fields of `Grade`."""

    exposure: float = option(0.0, "STOPS")
    """Brightness: 1 doubles the light."""
    contrast: float = option(1.0, "FACTOR")
    """Scale the distance from mid-gray."""
    curve: str | None = option(None, "X:Y,X:Y")
    """Monotone curve of each channel through these points, 0 to 1: 0.25:0.35 brightens the shadows;
    0.05:0,0.95:1 sets black and white points."""
    temperature: float = option(6500.0, "KELVIN")
    """White balance: above 6500 warmer, below colder; 1667 to 25000."""
    tint: float = option(0.0, "STOPS")
    """Above 0 towards magenta, below towards green."""
    saturation: float = option(1.0, "FACTOR")
    """Strength of colors: 0 is black and white."""
    hue: float = option(0.0, "DEGREES")
    """Turn all hues, red towards green."""

    def grade(self) -> Grade:
        """Return the grade of the options. Raises UsageError."""
        from gsedit.toolkit.grade import Grade, parse_curve

        points = () if self.curve is None else parse_curve(self.curve)
        return Grade(**{**vars(self), "curve": points})


@dataclass(frozen=True)
class RecolorOptions:
    """Options of `gsedit recolor` alone."""

    palette: Path | None = option(None, "PICTURE")
    """Give the scene the colors of a picture, after the grading. The whole scene is held in
    memory."""
    strength: float = option(1.0, "0..1", min=0, max=1)
    """Share of the way to the picture's colors."""
    opacity: float | None = option(None, "0..1", min=0, max=1)
    """Set the opacity of what is selected."""
    opacity_scale: float = option(1.0, "FACTOR", min=0)
    """Multiply the opacity, to at most 1."""


@shows(
    "--exposure", "--contrast", "--curve", "--temperature", "--tint", "--saturation",
    "--palette", "--opacity", "--where", "--output", "--force",
)  # fmt: skip
def recolor(
    *, own: RecolorOptions, grading: GradeOptions, selection: SelectionOptions
) -> list[Operation]:
    """Change colors and opacities, as in a photo editor.

    gsedit recolor scene.ply --exposure 0.5 --temperature 7500 --saturation 1.2 -o warm.ply

    gsedit recolor scene.ply --saturation 0 --where "not sphere(0, 0, 0, 1)" -o spot.ply

    gsedit recolor scene.ply --palette painting.jpg -o painted.ply

    The order: temperature, tint, exposure, contrast, saturation, hue, curve, palette, opacity.
    """
    part, grade = selection.selection(), grading.grade()

    from gsedit.toolkit.grade import Grade
    from gsedit.toolkit.operation import OnOnePart
    from gsedit.toolkit.recolor import Opacity, Palette, Recolor

    operations: list[Operation] = []
    if grade != Grade():
        operations.append(Recolor(grade, selection=part))
    if own.palette is not None:
        operations.append(Palette(own.palette, own.strength, selection=part))
    if own.opacity is not None or own.opacity_scale != 1:
        operations.append(Opacity(own.opacity, own.opacity_scale, selection=part))
    if not operations:
        raise UsageError("recolor changes nothing: give --exposure, --palette or another option")
    # new colors and opacities must not change what is selected
    return [OnOnePart(tuple(operations), part)] if len(operations) > 1 else operations
