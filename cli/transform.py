"""`gsedit transform`: move, turn, scale and mirror splats."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .ordered import in_order, step_option
from .selection_options import SelectionOptions, numbers

if TYPE_CHECKING:
    from gsedit.points.transform import Transform, TransformAboutCentre

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
    typer.Option(
        "--pivot", metavar="X,Y,Z|center", show_default=False,
        help="Point to turn, scale and mirror about. Default: the origin.",
    ),
]  # fmt: skip
Center = Annotated[
    bool, typer.Option("--center", help="First move the median of the centres to the origin.")
]
Inverse = Annotated[bool, typer.Option("--inverse", help="Do the inverse of all steps together.")]
Copy = Annotated[bool, typer.Option("--copy", help="Keep the originals too: duplicate.")]
Cameras = Annotated[
    bool,
    typer.Option("--cameras", help="Move the scene's cameras.json along, to OUTPUT.cameras.json."),
]


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
) -> Transform | TransformAboutCentre:
    """Move, turn, scale and mirror splats; covariances and SH follow exactly.

    Steps are done in the order in which they stand on the command line. With options that select,
    only the selected part moves.

    gsedit transform scene.ply --up z,-y --scale 2 --translate 0,1,0 -o moved.ply
    """
    from gsedit.errors import UsageError
    from gsedit.points.steps import compose
    from gsedit.points.transform import transform_of

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
    """What a step takes, from the text of its option."""
    flag = f"--{name.replace('_', '-')}"
    counts = {"translate": 3, "rotate": 3, "rotate_axis": 4, "quat": 4}
    if name in counts:
        return numbers(flag, text, counts[name])
    if name == "scale":
        return numbers(flag, text, 1)[0]
    if name == "up":
        return text.split(",")
    if name == "matrix":
        from gsedit.files.similarity_files import read_similarity

        return read_similarity(Path(text)).matrix
    return text
