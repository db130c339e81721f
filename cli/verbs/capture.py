"""`gsedit capture`: photos or a video into a folder of posed photos."""

from __future__ import annotations

import os
from dataclasses import asdict
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from gsedit.capture.settings import CaptureSettings

from ..core.command import Seeded, Settings, Values, argument, settings_of, shows, with_values
from ..core.console import as_json, print_message, print_result
from ..core.exits import Interrupted
from ..core.outputs import check_folder
from ..core.progress import progress, result_of
from ..options.common import Folder

if TYPE_CHECKING:
    from gsedit.capture.capture import CaptureResult
    from gsedit.capture.stages import Line

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")

Source = Annotated[
    Path, argument("PHOTOS", "A folder of photos of one scene (folders in it too), or a video.")
]
SETTINGS = Settings(partial(settings_of, CaptureSettings(), without=("seed", "threads")))
"""An option for each field of CaptureSettings; --threads and --seed are those of every verb."""


@shows("--output", "--frames", "--lens", "--focal", "--mask", "--size", "--force", "--seed")
def capture(
    photos: Source, *, own: Folder, values: Annotated[Values, SETTINGS], common: Seeded
) -> None:
    """Find the camera of each photo, for gsedit fit.

    gsedit capture photos/ -o scene/

    Walk around the subject and take 20 to 100 photos that overlap, or a video. After an
    interruption, the same command continues; -f starts again.
    """
    settings = settings_from(values, common)
    result = run_capture(photos, own.out, settings, force=own.force)
    print_capture(result, own.out)
    print_result(asdict(result), str(own.out))


def settings_from(values: Values, common: Seeded) -> CaptureSettings:
    """The settings that options ask for."""
    seed = common.seed % 2**31  # COLMAP takes 32 bits, and -1 as no seed
    everyday = {("seed",): seed, ("threads",): common.threads or -1}
    return with_values(CaptureSettings(), {**values, **everyday})


def run_capture(
    photos: Path, out: Path, settings: CaptureSettings, *, force: bool
) -> CaptureResult:
    """Capture with progress on the terminal. Raises Interrupted with what is left of the work."""
    from gsedit.capture import capture as work
    from gsedit.run.events import Event

    work.check_places(photos, out)
    work.check_frames(photos, settings)
    check_folder(out, force or work.is_begun(out))
    if force:
        work.start_anew(out)
    try:
        with progress() as show:
            handlers = {work.Line: print_line, Event: show}
            return result_of(work.capture_steps(photos, out, settings), handlers)
    except KeyboardInterrupt:
        raise Interrupted(
            f"interrupted; the stages that ended are kept in {out / work.WORK}: go on with the "
            "same command"
        ) from None


def print_line(line: Line) -> None:
    """Print a remark; its option for a person alone."""
    option = "" if as_json.get() or not line.option else f" ({line.option})"
    print_message(f"{line.text}{option}")


def print_capture(result: CaptureResult, out: Path) -> None:
    """The one screen at the end: what was posed, how well, and what to do next."""
    lines = [capture_summary(result)]
    if (picture := out / "capture.png").is_file():  # it needs OpenGL
        lines.append(f"look:  {picture}")
    scene = f"{os.path.basename(os.path.realpath(out)) or 'scene'}.ply"
    lines.append(f"next:  gsedit fit {quote(str(out))} -o {quote(scene)}")
    print_message("\n".join(lines))


def capture_summary(result: CaptureResult) -> str:
    """Two lines: what was posed and how well; the cameras."""
    from gsedit.capture.causes import listed

    focals = dict.fromkeys(f"{mm:g} mm ({source}, refined)" for mm, source in result.focals)
    return (
        f"{result.posed} of {result.photos} photos posed{_islands(result.islands)}, "
        f"reprojection error {result.error:.2f} px, {result.points:,} points, "
        f"{result.seconds:.0f} s\n"
        f"focal length in 35 mm equivalents: {listed(list(focals))}; upright by {result.upright}"
    )


def _islands(sizes: tuple[int, ...]) -> str:
    """ ", two islands of 52 and 8" where there are several."""
    if len(sizes) < 2:
        return ""
    number = NUMBERS[len(sizes)] if len(sizes) < len(NUMBERS) else str(len(sizes))
    listed = ", ".join(map(str, sizes[:-1]))
    return f", {number} islands of {listed} and {sizes[-1]} (the largest is the scene)"
