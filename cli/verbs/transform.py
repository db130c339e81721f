"""`gsedit transform`: move, turn, scale and mirror splats."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gsedit.errors import UsageError

from ..core.command import flag, shows
from ..options.numbers import numbers
from ..options.selection import SelectionOptions

if TYPE_CHECKING:
    from gsedit.toolkit.transform import Transform

_PLACES = count()


class Step(str):
    """The text of an option, with its place among those of the command line."""

    place: int


def step_option(name: str, metavar: str, help: str) -> Any:
    """A typer.Option whose parameter is `list[str] | None`: a `Step` if it was given."""
    return flag(name, help, metavar, callback=_placed)


def in_order(steps: dict[str, list[str] | None]) -> list[tuple[str, str]]:
    """The name and the text of the steps that were given, in their order."""
    given = [(name, texts[0]) for name, texts in steps.items() if texts]
    return sorted(given, key=lambda pair: getattr(pair[1], "place", 0))


def _placed(value: list[str] | None) -> list[Step] | None:
    """typer calls this for the options in the order of the command line."""
    if not value:
        return None
    if len(value) > 1:
        raise typer.BadParameter("given twice: chain the second with then, as in then transform")
    step = Step(value[0])
    step.place = next(_PLACES)
    return [step]


Texts = list[str] | None
Translate = Annotated[Texts, step_option("--translate", "X,Y,Z", "Move, in world units.")]
Rotate = Annotated[
    Texts,
    step_option("--rotate", "X,Y,Z", "Turn by degrees about the fixed axes: x first, then y, z."),
]
RotateAxis = Annotated[
    Texts,
    step_option("--rotate-axis", "AX,AY,AZ,DEG", "Turn by degrees about an axis, right-handed."),
]
Quat = Annotated[Texts, step_option("--quat", "W,X,Y,Z", "Turn by a quaternion.")]
Scale = Annotated[Texts, step_option("--scale", "FACTOR", "Scale all axes.")]
Mirror = Annotated[Texts, step_option("--mirror", "x|y|z", "Change the sign of one axis.")]
Up = Annotated[
    Texts,
    step_option("--up", "FROM,TO", "Turn so that what is up, as z, becomes another axis, as -y."),
]
Matrix = Annotated[
    Texts,
    step_option("--matrix", "FILE", "Apply a 4x4 matrix: .json (as --save writes), .npy, or text."),
]
Pivot = Annotated[
    str | None,
    flag("--pivot", "Point to turn, scale and mirror about. Default: the origin.", "X,Y,Z|center"),
]
Center = Annotated[bool, flag("--center", "First move the median of the centers to the origin.")]
Inverse = Annotated[bool, flag("--inverse", "Do the inverse of all steps together.")]
Copy = Annotated[bool, flag("--copy", "Keep the originals too: duplicate.")]
Cameras = Annotated[
    bool, flag("--cameras", "Move the scene's cameras.json along, to OUTPUT.cameras.json.")
]


@shows(
    "--translate", "--rotate", "--scale", "--mirror", "--up", "--copy",
    "--cameras", "--where", "--region", "--output", "--force", "--dry-run",
)  # fmt: skip
def transform(
    translate: Translate = None,
    rotate: Rotate = None,
    rotate_axis: RotateAxis = None,
    quat: Quat = None,
    scale: Scale = None,
    mirror: Mirror = None,
    up: Up = None,
    matrix: Matrix = None,
    pivot: Pivot = None,
    center: Center = False,
    inverse: Inverse = False,
    copy: Copy = False,
    cameras: Cameras = False,
    *,
    selection: SelectionOptions,
) -> Transform:
    """Move, turn, scale or mirror a scene or a part of it.

    gsedit transform scene.ply --up z,-y --scale 2 --translate 0,1,0 -o moved.ply

    Steps run in the order of the command line. Covariances and SH follow exactly.
    """
    from gsedit.toolkit.transform import compose, transform_of

    given = in_order(
        {"translate": translate, "rotate": rotate, "rotate_axis": rotate_axis, "quat": quat,
         "scale": scale, "mirror": mirror, "up": up, "matrix": matrix}
    )  # fmt: skip
    if not given and not center and not copy:
        raise UsageError("name what to do: --translate, --rotate, --scale, --mirror, --up, ...")
    whole = compose((name, _value(name, text)) for name, text in given)
    if inverse:
        whole = whole.inverse
    point = pivot if pivot in (None, "center") else numbers("--pivot", str(pivot), 3)
    part = selection.selection()
    return transform_of(
        whole, pivot=point, center=center, selection=part, copy=copy, cameras=cameras
    )


def _value(name: str, text: str) -> Any:
    """Return the value of a step from the text of its option."""
    flag = f"--{name.replace('_', '-')}"
    counts = {"translate": 3, "rotate": 3, "rotate_axis": 4, "quat": 4}
    if name in counts:
        return numbers(flag, text, counts[name])
    if name == "scale":
        return numbers(flag, text, 1)[0]
    if name == "up":
        return text.split(",")
    if name == "matrix":
        from gsedit.toolkit.similarity_files import read_similarity

        return read_similarity(Path(text)).matrix
    return text
