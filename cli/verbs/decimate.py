"""`gsedit decimate`: fewer Gaussians with the same look."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gsedit.errors import UsageError

from ..core.command import argument, flag, option

if TYPE_CHECKING:
    from gsedit.toolkit.decimate import Decimate

Amount = Annotated[str, argument("AMOUNT", "Share to keep, as 50%, or number, as 200000.")]
Measure = Annotated[
    bool, flag("--measure/--no-measure", "Measure how much pictures change, in dB.")
]
Cameras = Annotated[
    Path | None,
    flag("--cameras", "Cameras to measure from.", "CAMERAS.JSON", show_default="an orbit"),
]


@dataclass(frozen=True)
class DecimateOptions:
    """Options of `gsedit decimate` alone."""

    method: str = option(
        "merge",
        "merge: join neighbors. importance: keep the largest opacity times area. random: keep any.",
        "merge|importance|random",
    )


def decimate(
    amount: Amount,
    measure: Measure = True,
    cameras: Cameras = None,
    *,
    own: DecimateOptions,
) -> Decimate:
    """Reduce the number of Gaussians.

    gsedit decimate scene.ply 50% -o half.ply
    """
    kept = amount_of(amount)
    from gsedit.toolkit.decimate import Decimate

    views = None
    if cameras is not None:
        from gsedit.datasets.cameras_json import read_cameras

        views = [viewpoint.camera for viewpoint in read_cameras(cameras)]
    return Decimate(**kept, method=own.method, measure=measure, views=views)


def amount_of(text: str) -> dict[str, Any]:
    """Read 50% as a share and 200000 as a count. Raises UsageError."""
    try:
        if text.endswith("%"):
            return {"share": float(text[:-1]) / 100}
        return {"count": int(text.replace(",", ""))}
    except ValueError:
        raise UsageError(f"{text}: give a share, as 50%, or a number of Gaussians") from None
