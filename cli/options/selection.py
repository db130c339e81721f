"""Options that select Gaussians, the same for every verb that acts on a part of a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError

from ..core.command import flag, option
from ..core.console import print_message
from ..core.current import current_scene
from .pointing import finder_in

if TYPE_CHECKING:
    from gsedit.select.rules import Selection

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
        "Select a region of gsedit edit: auto (the subject), a saved name, box:X,Y,Z,X,Y,Z, "
        "sphere:X,Y,Z,R, a .npy file of flags, or masks on photos (.png or a folder).",
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
        from gsedit.select.rules import EVERYTHING

        if self.where is None:
            return EVERYTHING if self.region is None else parse_region(self.region, self.data)
        part = parse_where(self.where, self.data)
        return part if self.region is None else parse_region(self.region, self.data) & part


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
    from gsedit.select.where import where

    try:
        return where(text, view_functions(data))
    except UsageError as error:
        raise UsageError(f"--where {error}") from None


def parse_region(text: str, data: Path | None) -> Selection:
    """Read what `--region` selects in the scene that the verb reads. Raises UsageError."""
    from gsedit.select.where import check_region

    return check_region(text, view_functions(data))


def view_functions(data: Path | None) -> dict[str, Callable[..., Selection]]:
    """Return the functions of an expression that look at a scene, by name.

    They look through the cameras of `data`, or those beside the current scene; what was found is
    printed. Without an argument `cameras`, `seen` and `middle` need one of the two.
    """
    from gsedit.select.rules import LEAST_PIXELS, flags
    from gsedit.select.rules import middle as in_the_middle
    from gsedit.select.rules import seen as seen_in
    from gsedit.select.where import questions

    scene = str(current_scene.get() or "")

    def cameras_of(given: str, name: str) -> str:
        return given or str(recorded_cameras(f"{name}()", data))

    def seen(cameras: str = "", pixels: float = LEAST_PIXELS) -> Selection:
        return seen_in(cameras_of(cameras, "seen"), pixels, scene)

    def middle(within: float = 0.5, cameras: str = "") -> Selection:
        return in_the_middle(within, cameras_of(cameras, "middle"), scene)

    asked = questions(finder_in(data), lambda found: print_message(f"region: {found}"))
    # flags: of rows as the file has them, without a look
    return {**asked, "seen": seen, "middle": middle, "flags": flags}


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
