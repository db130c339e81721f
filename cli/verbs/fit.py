"""`gsedit fit`: a scene from a folder of posed photos."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from gsedit.capture.fitting.settings import LEAST_STEPS, QUALITIES, FitSettings

from ..core.checkpoints import Checkpoints, load_resume_state, say_threads
from ..core.command import (
    Seeded,
    Settings,
    Values,
    argument,
    option,
    settings_of,
    shows,
    with_values,
)
from ..core.console import print_message, print_result
from ..core.kernel import FITS, say_kernel
from ..core.outputs import check_scene_file
from ..core.progress import progress, result_of
from ..options.cameras import load_photos
from ..options.common import Reads, Resumes, load_scene

if TYPE_CHECKING:
    from gsedit.capture.fitting.fit import FitResult
    from gsedit.scene.similarity import Similarity
    from gsedit.views.dataset import Dataset as Photos

CHECKPOINT = ".checkpoint.safetensors"
"""Suffix of the checkpoint of a fit, in place of the scene's."""

Dataset = Annotated[
    Path, argument("DATASET", "Folder of posed photos: nerfstudio (transforms.json) or COLMAP.")
]
SETTINGS = Settings(partial(settings_of, FitSettings(), without=("seconds", "coarse")))
"""An option for each field of FitSettings; --minutes stands for `seconds`."""


@dataclass(frozen=True)
class Recipe:
    """How well a scene is fitted, and how long that takes."""

    size: int | None = option(None, "PIXELS", min=16)
    """Longer side of the photos. None: as they are, up to 1,024."""
    quality: Literal["draft", "normal", "high"] = option("normal")
    """draft: 2,000 steps, 100,000 Gaussians, about 2 minutes. normal: 6,000, 150,000, 5. high:
    16,000, 300,000, SH degree 2, 15. Options that are given win."""
    minutes: float | None = option(None, min=0.01)
    """Fit for this time, whatever the steps. None: the steps of --quality."""

    def pixels(self) -> int:
        """Return the longer side of the photos."""
        return self.size or QUALITIES[self.quality].size

    def settings(self, values: Values) -> FitSettings:
        """Return the settings: those of the quality, replaced by given `values`.

        A budget of steps or of time lifts the other one of the quality.
        """
        budget = {}
        if self.minutes is not None or ("steps",) in values:
            seconds = self.minutes and 60 * self.minutes
            budget = {("seconds",): seconds, ("steps",): values.get(("steps",))}
        return with_values(QUALITIES[self.quality].settings, {**values, **budget})


@dataclass(frozen=True)
class FitOptions(Reads, Resumes):
    """Output of a fit, and where it starts."""

    out: Path = option(..., "PATH", flags="--output -o")
    """Scene to write: .ply, .compressed.ply or .spz."""
    start: Path | None = option(None, "SCENE", flags="--from")
    """Start from this scene."""


@shows(
    "--output", "--quality", "--minutes", "--steps", "--size", "--max-gaussians", "--sh-degree",
    "--exposure", "--from", "--resume", "--force", "--seed",
)  # fmt: skip
def fit(
    dataset: Dataset,
    *,
    own: FitOptions,
    recipe: Recipe,
    values: Annotated[Values, SETTINGS],
    common: Seeded,
) -> None:
    """Fit a scene to posed photos.

    gsedit fit posed/ -o scene.ply --quality draft

    Every 8th photo is held out and measures the result. The cameras are written to cameras.json
    beside the scene. gsedit list settings fit explains every setting.
    """
    result = run_fit(dataset, own, recipe.pixels(), recipe.settings(values), common)
    if result is not None:
        print_fit(result, own.out)


def run_fit(
    dataset: Path, own: FitOptions, size: int, settings: FitSettings, common: Seeded
) -> FitResult:
    """Fit with progress on the terminal, and write the scene and its cameras."""
    check_scene_file(own.out, own.force)
    checkpoints = Checkpoints(
        own.out.with_suffix(CHECKPOINT), check=partial(check_scene_file, own.out, own.force)
    )
    state = load_resume_state(checkpoints.path, {}, "fit", resume=own.resume, force=own.force)
    say_threads(state)

    from gsedit.capture.fitting.fit import fit_steps
    from gsedit.formats.scenes import save
    from gsedit.run.events import Checkpoint, Event

    first = None if own.start is None else load_scene(own.start, drop_invalid=own.drop_invalid)
    photos = load_photos(dataset, size, own.start)
    frame = check_places(photos, dataset, own)
    say_kernel(settings.execution, FITS)
    steps = fit_steps(photos, settings, generator=common.generator(), start=first, resume=state)
    with checkpoints:
        with progress() as show:
            result = result_of(steps, {Event: show, Checkpoint: checkpoints.keep})
        say_too_short(result, settings)
        save(result.scene, own.out, overwrite=own.force)
        write_places(photos, frame, own.out, own.force)
    return result


def check_places(photos: Photos, dataset: Path, own: FitOptions) -> Similarity | None:
    """Return what `write_places` is to write beside the cameras. Raises UsageError where it could
    not write that or the cameras."""
    from gsedit.views.cameras_json import place_beside
    from gsedit.views.export_frame import frame_beside, frame_place

    place_beside(own.out, photos.views, overwrite=own.force)
    frame = frame_beside(photos, dataset, own.out, own.start)
    if frame is not None:
        frame_place(frame, own.out, overwrite=own.force)
    return frame


def say_too_short(result: FitResult, settings: FitSettings) -> None:
    """Print a line where the time allowed no more than the least steps."""
    if settings.seconds and result.steps <= LEAST_STEPS and result.seconds > settings.seconds:
        print_message(
            f"{settings.seconds:g} s are too short for these photos: reading them and the start "
            f"left time for {result.steps} steps, and the scene is hardly fitted: give --minutes "
            f"{max(1, ceil(10 * result.seconds / 60))} or more, or fewer photos"
        )


def write_places(photos: Photos, frame: Similarity | None, out: Path, force: bool) -> None:
    """Write the cameras beside the scene, and how its frame came from that of the photos."""
    from gsedit.views.cameras_json import write_beside
    from gsedit.views.export_frame import write_export_frame

    cameras = write_beside(out, photos.views, overwrite=force)
    print_message(f"the cameras are in {cameras}: edit, render and view use them")
    if frame is not None:
        path = write_export_frame(frame, out, overwrite=force)
        print_message(
            f"{path} says how to get back to the frame of the photos (docs/reference/datasets.md)"
        )


def print_fit(result: FitResult, out: Path) -> None:
    """Print what the fit came to."""
    print_message(
        f"{len(result.scene)} Gaussians, {result.psnr:.2f} dB on held-out photos, "
        f"{result.steps} steps in {result.seconds:.0f} s; look: gsedit view {out}"
    )
    record = {
        "scene": out,
        "gaussians": len(result.scene),
        "psnr": result.psnr,
        "steps": result.steps,
        "seconds": result.seconds,
        "curve": result.curve,
    }
    print_result(record, str(out))
