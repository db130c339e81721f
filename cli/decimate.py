"""`gsedit decimate`: fewer Gaussians with the same look."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from gsedit.points.decimate import Decimate

Amount = Annotated[
    str,
    typer.Argument(
        metavar="AMOUNT", help="Share to keep, as 50%, or number, as 200000.", show_default=False
    ),
]
Method = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="merge|importance|random",
        help="merge: join near ones. importance: keep those of most opacity times area. "
        "random: keep any.",
    ),
]
Measure = Annotated[
    bool,
    typer.Option("--measure/--no-measure", help="Tell how much pictures change, in dB."),
]
Cameras = Annotated[
    Path | None,
    typer.Option(
        "--cameras",
        metavar="CAMERAS.JSON",
        show_default=False,
        help="Measure from these cameras. Default: an orbit.",
    ),
]


def decimate(
    amount: Amount,
    method: Method = "merge",
    measure: Measure = True,
    cameras: Cameras = None,
) -> Decimate:
    """Join near Gaussians until a number or a share of them is left.

    gsedit decimate scene.ply 50% -o half.ply
    """
    from gsedit.points.decimate import Decimate

    views = None
    if cameras is not None:
        from gsedit.files.cameras import read_cameras

        views = [viewpoint.camera for viewpoint in read_cameras(cameras)]
    return Decimate(**amount_of(amount), method=method, measure=measure, views=views)


def amount_of(text: str) -> dict[str, Any]:
    """50% as a share, 200000 as a count. Raises UsageError."""
    from gsedit.errors import UsageError

    try:
        if text.endswith("%"):
            return {"share": float(text[:-1]) / 100}
        return {"count": int(text.replace(",", ""))}
    except ValueError:
        raise UsageError(f"{text}: give a share, as 50%, or a number of Gaussians") from None
