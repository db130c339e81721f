"""`gsedit recolor`: colours and opacities, as in a photo editor; the palette of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .selection_options import SelectionOptions

if TYPE_CHECKING:
    from gsedit.points.grade import Grade
    from gsedit.points.operation import Operation


def slider(flag: str, metavar: str, panel: str, help: str, **more: Any) -> Any:
    """An option of the grading."""
    return typer.Option(flag, metavar=metavar, rich_help_panel=panel, help=help, **more)


@dataclass(frozen=True)
class GradeOptions:
    """The fields of `Grade`."""

    exposure: Annotated[float, slider("--exposure", "STOPS", "Light", "1: twice the light.")] = 0.0
    contrast: Annotated[
        float, slider("--contrast", "FACTOR", "Light", "Of the distance from mid-grey.")
    ] = 1.0
    curve: Annotated[
        str | None,
        slider(
            "--curve",
            "X:Y,X:Y",
            "Light",
            "Monotone curve of each channel through these points, 0 to 1: 0.25:0.35 brightens the "
            "shadows; 0.05:0,0.95:1 sets black and white points.",
            show_default=False,
        ),
    ] = None
    temperature: Annotated[
        float,
        slider(
            "--temperature",
            "KELVIN",
            "Colour",
            "White balance: above 6500 warmer, below colder; 1667 to 25000.",
        ),
    ] = 6500.0
    tint: Annotated[
        float,
        slider(
            "--tint",
            "STOPS",
            "Colour",
            "Of green taken away: above 0 towards magenta, below towards green.",
        ),
    ] = 0.0
    saturation: Annotated[
        float, slider("--saturation", "FACTOR", "Colour", "0: black and white.")
    ] = 1.0
    hue: Annotated[
        float, slider("--hue", "DEGREES", "Colour", "Turn of all hues, red towards green.")
    ] = 0.0

    def grade(self) -> Grade:
        """What the options say. Raises UsageError."""
        from gsedit.points.grade import Grade, parse_curve

        points = () if self.curve is None else parse_curve(self.curve)
        return Grade(**{**vars(self), "curve": points})


Palette = Annotated[
    Path | None,
    slider(
        "--palette",
        "PICTURE",
        "Palette",
        "Give the scene the colours of a picture, after the grading. The whole scene is held in "
        "memory.",
        show_default=False,
    ),
]
Strength = Annotated[
    float,
    slider("--strength", "0..1", "Palette", "How far colours go to the picture's.", min=0, max=1),
]
SetOpacity = Annotated[
    float | None,
    slider("--opacity", "0..1", "Opacity", "Set it.", min=0, max=1, show_default=False),
]
OpacityScale = Annotated[
    float, slider("--opacity-scale", "FACTOR", "Opacity", "Multiply it, to at most 1.", min=0)
]


def recolor(
    *,
    grading: GradeOptions,
    palette: Palette = None,
    strength: Strength = 1.0,
    opacity: SetOpacity = None,
    opacity_scale: OpacityScale = 1.0,
    selection: SelectionOptions,
) -> list[Operation]:
    """Change colours and opacities as in a photo editor, of all Gaussians or of those selected.

    The order: temperature, tint, exposure, contrast, saturation, hue, curve, palette, opacity.

    gsedit recolor scene.ply --exposure 0.5 --temperature 7500 --saturation 1.2 -o warm.ply

    gsedit recolor scene.ply --saturation 0 --where "not sphere(0, 0, 0, 1)" -o spot.ply

    gsedit recolor scene.ply --palette painting.jpg -o painted.ply
    """
    part, grade = selection.selection(), grading.grade()

    from gsedit.errors import UsageError
    from gsedit.points import palette as palettes
    from gsedit.points.grade import Grade
    from gsedit.points.recolor import Opacity, Recolor
    from gsedit.points.selection.part import OnOnePart

    operations: list[Operation] = []
    if grade != Grade():
        operations.append(Recolor(grade, selection=part))
    if palette is not None:
        operations.append(palettes.Palette(palette, strength, selection=part))
    if opacity is not None or opacity_scale != 1:
        operations.append(Opacity(opacity, opacity_scale, selection=part))
    if not operations:
        raise UsageError("recolor changes nothing: give --exposure, --palette or another option")
    # new colours and opacities must not change what is selected
    return [OnOnePart(tuple(operations), part)] if len(operations) > 1 else operations
