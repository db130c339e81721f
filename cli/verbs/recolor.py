"""`gsedit recolor`: colors and opacities, as in a photo editor; the palette of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError

from ..core.command import flag, option, shows
from ..options.selection import SelectionOptions

if TYPE_CHECKING:
    from gsedit.toolkit.grade import Grade
    from gsedit.toolkit.operation import Operation


@dataclass(frozen=True)
class GradeOptions:
    """The fields of `Grade`."""

    exposure: float = option(0.0, "1 doubles the light.", "STOPS")
    contrast: float = option(1.0, "Scale the distance from mid-gray.", "FACTOR")
    curve: str | None = option(
        None,
        "Monotone curve of each channel through these points, 0 to 1: 0.25:0.35 brightens the "
        "shadows; 0.05:0,0.95:1 sets black and white points.",
        "X:Y,X:Y",
    )
    temperature: float = option(
        6500.0, "White balance: above 6500 warmer, below colder; 1667 to 25000.", "KELVIN"
    )
    tint: float = option(0.0, "Above 0 towards magenta, below towards green.", "STOPS")
    saturation: float = option(1.0, "0 is black and white.", "FACTOR")
    hue: float = option(0.0, "Turn all hues, red towards green.", "DEGREES")

    def grade(self) -> Grade:
        """Return the grade of the options. Raises UsageError."""
        from gsedit.toolkit.grade import Grade, parse_curve

        points = () if self.curve is None else parse_curve(self.curve)
        return Grade(**{**vars(self), "curve": points})


Palette = Annotated[
    Path | None,
    flag(
        "--palette",
        "Give the scene the colors of a picture, after the grading. The whole scene is held in "
        "memory.",
        "PICTURE",
        rich_help_panel="Palette",
    ),
]


@dataclass(frozen=True)
class RecolorOptions:
    """Options of `gsedit recolor` alone."""

    strength: float = option(1.0, "Share of the way to the picture's colors.", "0..1", min=0, max=1)
    opacity: float | None = option(None, "Set the opacity.", "0..1", min=0, max=1)
    opacity_scale: float = option(1.0, "Multiply the opacity, to at most 1.", "FACTOR", min=0)


@shows(
    "--exposure", "--contrast", "--curve", "--temperature", "--tint", "--saturation",
    "--palette", "--opacity", "--where", "--output", "--force",
)  # fmt: skip
def recolor(
    *,
    own: RecolorOptions,
    grading: GradeOptions,
    palette: Palette = None,
    selection: SelectionOptions,
) -> list[Operation]:
    """Change colors and opacities, as in a photo editor.

    gsedit recolor scene.ply --exposure 0.5 --temperature 7500 --saturation 1.2 -o warm.ply

    gsedit recolor scene.ply --saturation 0 --where "not sphere(0, 0, 0, 1)" -o spot.ply

    gsedit recolor scene.ply --palette painting.jpg -o painted.ply

    The order: temperature, tint, exposure, contrast, saturation, hue, curve, palette, opacity.
    """
    part, grade = selection.selection(), grading.grade()

    from gsedit.toolkit import palette as palettes
    from gsedit.toolkit.grade import Grade
    from gsedit.toolkit.operation import OnOnePart
    from gsedit.toolkit.recolor import Opacity, Recolor

    operations: list[Operation] = []
    if grade != Grade():
        operations.append(Recolor(grade, selection=part))
    if palette is not None:
        operations.append(palettes.Palette(palette, own.strength, selection=part))
    if own.opacity is not None or own.opacity_scale != 1:
        operations.append(Opacity(own.opacity, own.opacity_scale, selection=part))
    if not operations:
        raise UsageError("recolor changes nothing: give --exposure, --palette or another option")
    # new colors and opacities must not change what is selected
    return [OnOnePart(tuple(operations), part)] if len(operations) > 1 else operations
