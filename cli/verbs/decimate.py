"""`gsedit decimate`: fewer Gaussians with the same look, as one scene or several levels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gsedit.errors import UsageError

from ..core.command import argument, flag, option
from ..core.process import Levels

if TYPE_CHECKING:
    from gsedit.toolkit.decimate import Decimate

Amount = Annotated[str, argument("AMOUNT", "Share to keep, as 50%, or number, as 200000.")]
Format = Annotated[
    str,
    flag("--format", "Format of the levels, as ply or spz.", "SUFFIX"),
]
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
    levels: int | None = option(
        None,
        "Write N levels of detail into the folder -o: the scene, then each level with AMOUNT "
        "(a share) of the Gaussians of the one before.",
        "N",
        min=2,
        max=16,
    )


def decimate(
    amount: Amount,
    format: Format = "ply",
    measure: Measure = True,
    cameras: Cameras = None,
    *,
    own: DecimateOptions,
) -> Decimate | Levels:
    """Reduce the number of Gaussians, or write levels of detail.

    gsedit decimate scene.ply 50% -o half.ply

    gsedit decimate scene.ply 50% --levels 4 -o folder
    """
    kept = amount_of(amount)
    if own.levels is not None:
        return levels_of(own.levels, kept, own.method, format, measure, cameras)
    from gsedit.toolkit.decimate import Decimate

    views = None
    if cameras is not None:
        from gsedit.datasets.cameras_json import read_cameras

        views = [viewpoint.camera for viewpoint in read_cameras(cameras)]
    return Decimate(**kept, method=own.method, measure=measure, views=views)


def levels_of(
    count: int, kept: dict[str, Any], method: str, format: str, measure: bool, cameras: Path | None
) -> Levels:
    """Return the levels that are asked for. Raises UsageError for what levels do not have."""
    from gsedit.formats.registry import writable_format

    if method != "merge" or cameras is not None:
        raise UsageError("--levels joins neighbors and measures from an orbit: leave out --method "
                         "and --cameras")  # fmt: skip
    if "share" not in kept:
        raise UsageError("--levels needs a share as AMOUNT, as in gsedit decimate SCENE 50%")
    suffix = format.lstrip(".")
    writable_format(Path(f"level.{suffix}"))
    return Levels(count, kept["share"], suffix, measure)


def amount_of(text: str) -> dict[str, Any]:
    """Read 50% as a share and 200000 as a count. Raises UsageError."""
    try:
        if text.endswith("%"):
            return {"share": float(text[:-1]) / 100}
        return {"count": int(text.replace(",", ""))}
    except ValueError:
        raise UsageError(f"{text}: give a share, as 50%, or a number of Gaussians") from None
