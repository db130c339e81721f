"""`gsedit clean`: what is no part of the captured scene, removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message
from .options import Data, check_file

if TYPE_CHECKING:
    from gsedit.points.clean import Clean
    from gsedit.points.survey import Limits
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

    from .operations import Output

WHAT = "What is removed"


def reason(flag: str, help: str) -> Any:
    """The option that switches a reason on or off."""
    return typer.Option(f"--{flag}/--no-{flag}", help=help, rich_help_panel=WHAT)


def limit(flag: str, metavar: str, help: str) -> Any:
    """The option that sets a threshold."""
    return typer.Option(flag, metavar=metavar, help=help, rich_help_panel=WHAT, min=0)


@dataclass(frozen=True)
class CleanOptions:
    """Which Gaussians go, and from which threshold on."""

    invisible: Annotated[
        bool, reason("invisible", "Gaussians that every renderer skips: --least-opacity.")
    ] = True
    giants: Annotated[
        bool, reason("giants", "Gaussians larger than the whole scene: --giant-size.")
    ] = True
    floaters: Annotated[
        bool, reason("floaters", "Gaussians far from all others: --floater-distance.")
    ] = True
    needles: Annotated[
        bool, reason("needles", "Long, thin streaks that end in the open: --needle-ratio.")
    ] = True
    duplicates: Annotated[bool, reason("duplicates", "Rows equal to an earlier one.")] = True
    unseen: Annotated[
        bool,
        reason(
            "unseen",
            "What none of the capture's cameras sees: those of --data or of the cameras.json "
            "beside the scene; without cameras nothing.",
        ),
    ] = True
    data: Data = None
    least_opacity: Annotated[
        float,
        limit("--least-opacity", "0..1", "Invisible: of less opacity than this (1/255)."),
    ] = 1 / 255
    giant_size: Annotated[
        float,
        limit(
            "--giant-size",
            "TIMES",
            "Giants: of a longest standard deviation above so many times the scene's radius.",
        ),
    ] = 1.0
    floater_distance: Annotated[
        float,
        limit(
            "--floater-distance",
            "TIMES",
            "Floaters: whose 8th neighbour is so many times as far as is usual around them.",
        ),
    ] = 5.0
    needle_ratio: Annotated[
        float,
        limit("--needle-ratio", "RATIO", "Needles: of a longer longest to middle axis than this."),
    ] = 5.0
    where: Annotated[
        str | None,
        typer.Option(
            "--where",
            metavar="EXPRESSION",
            help="Remove only what this selects, as in 'not sphere(0,0,0,1)' (docs/selection.md).",
            show_default=False,
        ),
    ] = None
    mark: Annotated[
        bool,
        typer.Option(
            "--mark", help="Remove nothing: write the reason's number into the column defect."
        ),
    ] = False
    reasons: Annotated[
        Path | None,
        typer.Option(
            "--reasons",
            metavar="FILE.npy",
            help="Also write the number of every row's reason, 0 for what is kept; with --dry-run "
            "too.",
            show_default=False,
        ),
    ] = None

    def limits(self) -> Limits:
        """The thresholds of the laws that are asked. Raises UsageError."""
        from gsedit.points.survey import Limits

        return Limits(
            invisible=self.least_opacity if self.invisible else None,
            giant=self.giant_size if self.giants else None,
            floater=self.floater_distance if self.floaters else None,
            needle=self.needle_ratio if self.needles else None,
            duplicates=self.duplicates,
        )


def clean(*, options: CleanOptions, output: Output) -> Clean:
    """Remove what is no part of the captured scene: floaters, needles, giants, the invisible.

    gsedit clean scene.ply -o cleaned.ply

    A line says how many Gaussians went for each reason; --dry-run only says it. Invalid rows are
    removed too: gsedit repair mends some. Each threshold and its reason are in docs/cleaning.md.
    """
    from gsedit.points.clean import Clean
    from gsedit.points.selection.where import where

    from .selection_options import labelled

    limits, reasons = options.limits(), options.reasons
    if reasons is not None:
        check_file(reasons, output.force)
    some = None if options.where is None else labelled("--where", where, options.where)
    cameras = partial(known_cameras, options.data) if options.unseen else None
    return Clean(limits, cameras, some, options.mark, reasons, output.force)


def known_cameras(data: Path | None, scene: Gaussians, path: Path | None) -> Sequence[Camera]:
    """The cameras of --data, or else of the cameras.json beside the scene file."""
    from gsedit.points.visibility import SIZE

    from .cameras import load_photos, recorded_viewpoints

    if data is not None:
        return [view.camera for view in load_photos(data, SIZE, path).views]
    found = recorded_viewpoints(path, scene, SIZE)
    if not found:
        print_message("no cameras are known (--data): what none saw is not looked for")
    return [viewpoint.camera for viewpoint in found]
