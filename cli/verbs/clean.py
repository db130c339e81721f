"""`gsedit clean`: remove or repair defective Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option, shows
from ..core.console import print_message
from ..core.outputs import check_file
from ..options.selection import SelectionOptions

if TYPE_CHECKING:
    from gsedit.toolkit.clean import Clean, Repair
    from gsedit.toolkit.defects import Limits
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

    from ..core.process import Output


@dataclass(frozen=True)
class CleanOptions:
    """Reasons to remove a Gaussian, and their thresholds."""

    invisible: bool = option(True, "Gaussians that every renderer skips: --least-opacity.")
    giants: bool = option(True, "Gaussians larger than the whole scene: --giant-size.")
    floaters: bool = option(True, "Gaussians far from all others: --floater-distance.")
    needles: bool = option(True, "Long, thin streaks that end in the open: --needle-ratio.")
    duplicates: bool = option(True, "Rows equal to an earlier one.")
    unseen: bool = option(
        True,
        "What none of the capture's cameras sees: those of --data or of the cameras.json "
        "beside the scene; without cameras nothing.",
    )
    least_opacity: float = option(
        1 / 255, "Invisible: of less opacity than this (1/255).", "0..1", min=0
    )
    giant_size: float = option(
        1.0,
        "Giants: of a longest standard deviation above so many times the scene's radius.",
        "TIMES",
        min=0,
    )
    floater_distance: float = option(
        5.0,
        "Floaters: whose 8th neighbor is so many times as far as is usual around them.",
        "TIMES",
        min=0,
    )
    needle_ratio: float = option(
        5.0, "Needles: of a longer longest to middle axis than this.", "RATIO", min=0
    )
    mark: bool = option(False, "Remove nothing: write the reason's number into the column defect.")
    reasons: Path | None = option(
        None,
        "Also write the number of every row's reason, 0 for what is kept; with --dry-run too.",
        "FILE.npy",
    )

    repair: bool = option(
        False,
        "Only mend Gaussians with NaN, Inf or a rotation of length 0, and remove those that "
        "cannot be mended.",
    )

    def limits(self) -> Limits:
        """The thresholds of the laws that are asked. Raises UsageError."""
        from gsedit.toolkit.defects import Limits

        return Limits(
            invisible=self.least_opacity if self.invisible else None,
            giant=self.giant_size if self.giants else None,
            floater=self.floater_distance if self.floaters else None,
            needle=self.needle_ratio if self.needles else None,
            duplicates=self.duplicates,
        )


@shows(
    "--where", "--region", "--data", "--repair", "--mark", "--least-opacity",
    "--giant-size", "--floater-distance", "--needle-ratio", "--output", "--force", "--dry-run",
)  # fmt: skip
def clean(*, options: CleanOptions, selection: SelectionOptions, output: Output) -> Clean | Repair:
    """Remove floaters, needles and giants, or repair invalid rows.

    gsedit clean scene.ply -o cleaned.ply

    gsedit clean broken.ply --repair -o scene.ply

    The command prints how many Gaussians it removes for each reason. --no-floaters, --no-needles
    and so on switch a reason off. docs/howto/clean.md explains each reason and its threshold.
    """
    if options.repair:
        return repair_alone(options, selection)

    from gsedit.toolkit.clean import Clean

    limits, reasons = options.limits(), options.reasons
    check_file(reasons, output.force)
    some = selection.selection() if selection.given else None
    cameras = partial(known_cameras, selection.data) if options.unseen else None
    return Clean(limits, cameras, some, options.mark, reasons, output.force)


def repair_alone(options: CleanOptions, selection: SelectionOptions) -> Repair:
    """Return the repair of a scene. Raises UsageError for options that it does not have."""
    from gsedit.toolkit.clean import Repair

    if options != CleanOptions(repair=True) or selection.given:
        raise UsageError(
            "--repair only mends: leave out the other options, or chain two commands: gsedit clean "
            "SCENE --repair then clean -o OUT"
        )
    return Repair()


def known_cameras(data: Path | None, scene: Gaussians, path: Path | None) -> Sequence[Camera]:
    """The cameras of --data, or else of the cameras.json beside the scene file."""
    from gsedit.toolkit.clean import SIZE_PIXELS

    from ..options.cameras import load_photos, recorded_viewpoints

    if data is not None:
        return [view.camera for view in load_photos(data, SIZE_PIXELS, path).views]
    found = recorded_viewpoints(path, scene, SIZE_PIXELS)
    if not found:
        print_message("no cameras are known (--data): what none saw is not looked for")
    return [viewpoint.camera for viewpoint in found]
