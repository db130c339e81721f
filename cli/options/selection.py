"""Options that select Gaussians, the same for every verb that acts on a part of a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError
from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region

from ..core.command import flag, option
from ..core.current import current_scene

if TYPE_CHECKING:
    from gsedit.toolkit.selection.base import Selection

ABOUT_THE_SUBJECT = "turn it into bronze"
"""An instruction about the subject alone: the editor `small` predicts where the subject is."""

Where = Annotated[
    str | None,
    flag(
        "--where",
        "Select by value, volume, color or view, as in 'opacity > 0.1 and not sphere(0,0,0,1)'. "
        "docs/howto/select.md lists all forms.",
        "EXPRESSION",
    ),
]


@dataclass(frozen=True)
class SelectionOptions:
    """Options that select the Gaussians a verb acts on."""

    where: Where = None
    region: str | None = option(
        None,
        "Select a region of gsedit edit: auto (the subject), box:X,Y,Z,X,Y,Z, sphere:X,Y,Z,R, "
        "a .npy file of flags, or masks on photos (.png or a folder).",
        "REGION",
    )
    data: Path | None = option(
        None,
        "Cameras for a selection by views: posed photos, or a cameras.json.",
        "DATASET",
        show_default="cameras.json beside the scene",
    )

    @property
    def given(self) -> bool:
        """Whether --where or --region was given."""
        return self.where is not None or self.region is not None

    def selection(self) -> Selection:
        """Return the selection: everything if no option is given, the intersection of both.

        Raises UsageError for a text that cannot be read.
        """
        from gsedit.toolkit.selection.base import EVERYTHING

        if self.where is None:
            return EVERYTHING if self.region is None else region_selection(self.region, self.data)
        part = parse_where(self.where, self.data)
        return part if self.region is None else region_selection(self.region, self.data) & part


def need_selection(options: SelectionOptions, verb: str) -> Selection:
    """Return the selection of a verb's options. Raises UsageError where none is given."""
    if not options.given:
        raise UsageError(
            f"{verb} needs a selection: add --where EXPRESSION, as in --where 'opacity > 0.1', or "
            "--region REGION"
        )
    return options.selection()


def parse_where(text: str, data: Path | None) -> Selection:
    """Read the expression of --where. Raises UsageError.

    The functions that need cameras take those of `data`, or those beside the current scene.
    """
    from gsedit.toolkit.selection.where import where

    try:
        return where(text, view_functions(data))
    except UsageError as error:
        raise UsageError(f"--where {error}") from None


def view_functions(data: Path | None) -> dict[str, Callable[..., Selection]]:
    """Return the functions of an expression that look at a scene through cameras, by name.

    Without an argument `cameras` they take those of `data`, or those beside the current scene.
    """
    from gsedit.toolkit.selection.middle import InTheMiddle
    from gsedit.toolkit.selection.seen import LEAST_PIXELS, Drawn, Seen

    from .subject import Subject

    scene = current_scene.get()

    def cameras_of(given: str, name: str) -> Path:
        return Path(given) if given else recorded_cameras(f"{name}()", data)

    def seen(cameras: str = "", pixels: float = LEAST_PIXELS) -> Selection:
        return Seen(cameras_of(cameras, "seen"), pixels=pixels, scene=scene)

    def drawn(masks: str, cameras: str = "") -> Selection:
        return Drawn(cameras_of(cameras, "drawn"), masks=Path(masks).expanduser(), scene=scene)

    def middle(within: float = 0.5, cameras: str = "") -> Selection:
        return InTheMiddle(cameras_of(cameras, "middle"), within=within, scene=scene)

    def subject(instruction: str = ABOUT_THE_SUBJECT, cameras: str = "") -> Selection:
        return Subject(instruction, scene, Path(cameras) if cameras else data)

    return {"seen": seen, "drawn": drawn, "middle": middle, "subject": subject}


def region_selection(text: str, data: Path | None) -> Selection:
    """Return what `--region` selects in the scene that the verb reads. Raises UsageError."""
    from gsedit.toolkit.selection.base import EVERYTHING
    from gsedit.toolkit.selection.saved import Flags
    from gsedit.toolkit.selection.volumes import box, sphere

    match parse_region(text):
        case All():
            return EVERYTHING
        case Auto():
            return view_functions(data)["subject"](ABOUT_THE_SUBJECT)
        case Box(low, high):
            return box(*low, *high)
        case Sphere(center, radius):
            return sphere(*center, radius)
        case File(path) if path.suffix.lower() == ".npy":
            return Flags(path.expanduser())
        case File(path):
            return view_functions(data)["drawn"](str(path))


def recorded_cameras(asker: str, data: Path | None) -> Path:
    """Return `data`, or the cameras.json beside the scene. Raises UsageError without either."""
    from gsedit.datasets.cameras_json import cameras_file

    scene = current_scene.get()
    cameras = data or (cameras_file(scene) if scene else None)
    if cameras is None:
        raise UsageError(
            f"{asker} needs cameras: add --data with the photos' folder or a cameras.json"
        )
    return cameras
