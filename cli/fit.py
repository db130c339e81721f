"""`gsedit fit`: a scene from a folder of posed photos."""

from __future__ import annotations

from enum import Enum
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import say_notes
from .checkpoints import Checkpoints, Resume, going_on, run_to_result
from .console import print_message, print_result
from .file_options import FileOptions
from .kernel import FITS, say_kernel
from .options import DropInvalid, Force, Seeded, check_scene_file, load_scene, output
from .progress import progress
from .ranks import follow, is_first, of_first, ranks
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.fitting.fit import FitResult
    from gsedit.fitting.settings import FitSettings
    from gsedit.views.dataset import Dataset as Photos

FITTING = "Fitting"
CHECKPOINT = ".checkpoint.safetensors"
"""Suffix, in place of the scene's, of where an interrupted fit goes on."""

Dataset = Annotated[
    Path,
    typer.Argument(
        metavar="DATASET",
        show_default=False,
        help="Folder of posed photos: nerfstudio (transforms.json) or COLMAP.",
    ),
]
Start = Annotated[
    Path | None,
    typer.Option("--from", metavar="SCENE", show_default=False, help="Start from this scene."),
]
Minutes = Annotated[
    float | None,
    typer.Option(
        "--minutes",
        min=0.01,
        show_default="that of --quality, or no limit with --steps",
        rich_help_panel=FITTING,
        help="Stop after this time.",
    ),
]


class Level(str, Enum):
    """The names of gsedit.fitting.settings.QUALITIES."""

    DRAFT = "draft"
    NORMAL = "normal"
    HIGH = "high"


Quality = Annotated[
    Level,
    typer.Option(
        "--quality",
        metavar="draft|normal|high",
        rich_help_panel=FITTING,
        help="draft: 1.5 minutes, 120,000 Gaussians. normal: 5 minutes, 150,000. high: 15 minutes, "
        "300,000, SH degree 2, photos of 512 pixels. Options that are given win.",
    ),
]
PhotoSize = Annotated[
    int | None,
    typer.Option(
        "--size",
        min=16,
        metavar="PIXELS",
        show_default="256, with --quality high 512",
        help="Longer side of the photos.",
    ),
]


def fit_settings() -> list[Setting]:
    """An option for each field of FitSettings; --minutes stands for `seconds`."""
    from gsedit.fitting.settings import FitSettings

    panels = {"execution": "Rendering"}
    return settings_of(FitSettings(), Layout(FITTING, panels, without=("seconds", "coarse")))


def fit(
    dataset: Dataset,
    out: Annotated[Path, output("Scene to write: .ply, .compressed.ply or .spz.")],
    size: PhotoSize = None,
    start: Start = None,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    resume: Resume = False,
    *,
    quality: Quality = Level.NORMAL,
    minutes: Minutes = None,
    values: Annotated[Values, SettingsGroup(fit_settings)],
    common: Seeded,
) -> None:
    """Fit a scene to posed photos, and write their cameras to cameras.json beside it.

    Every 8th photo is held out and measures the result.

    gsedit fit photos/ -o scene.ply --quality draft
    """
    from gsedit.fitting.settings import QUALITIES

    chosen = QUALITIES[quality.value]
    result = run_fit(
        dataset, out, size or chosen.size, with_budget(values, minutes, chosen.settings),
        start=start, drop_invalid=drop_invalid, force=force, resume=resume, common=common,
    )  # fmt: skip
    if result is not None:
        print_fit(result, out, as_json=common.json)


def run_fit(
    dataset: Path,
    out: Path,
    size: int,
    settings: FitSettings,
    *,
    start: Path | None = None,
    drop_invalid: bool = False,
    force: bool = False,
    resume: bool = False,
    common: Seeded,
) -> FitResult | None:
    """Fit with progress on the terminal, and write the scene and its cameras; None on all ranks but
    the first."""
    check_scene_file(out, force)
    checkpoints = Checkpoints(out.with_suffix(CHECKPOINT))
    state = of_first(lambda: going_on(checkpoints.path, {}, "fit", resume=resume, force=force))
    common.apply()

    from gsedit.files import load_dataset, save
    from gsedit.files.export_frame import in_export_frame
    from gsedit.fitting.fit import fit_steps

    first = None if start is None else load_scene(start, drop_invalid=drop_invalid)
    photos = load_dataset(dataset, size=size)
    say_notes(photos)
    if start is not None:
        photos = in_export_frame(photos, dataset, start)
    say_kernel(settings.execution, FITS)
    steps = fit_steps(
        photos, settings, generator=common.generator(), start=first, resume=state, ranks=ranks()
    )
    if not is_first():
        return follow(steps)
    with checkpoints:
        with progress(as_json=common.json) as show:
            result = run_to_result(steps, show, checkpoints)
        say_too_short(result, settings)
        save(result.scene, out, overwrite=force, options=FileOptions().write(out))
        write_places(photos, dataset, out, start)
    return result


def say_too_short(result: FitResult, settings: FitSettings) -> None:
    """Print a line where the time allowed no more than the least steps."""
    from gsedit.fitting.budget import LEAST_STEPS

    if settings.seconds and result.steps <= LEAST_STEPS and result.seconds > settings.seconds:
        print_message(
            f"{settings.seconds:g} s are too short for these photos: reading them and the start "
            f"left time for {result.steps} steps, and the scene is hardly fitted: give --minutes "
            f"{max(1, ceil(10 * result.seconds / 60))} or more, or fewer photos"
        )


def write_places(photos: Photos, dataset: Path, out: Path, start: Path | None) -> None:
    """Write the cameras beside the scene, and how its frame came from that of the photos: it is in
    the frame of the scene that it started from, if there was one."""
    from gsedit.files.cameras import write_beside
    from gsedit.files.export_frame import copy_export_frame, write_export_frame

    cameras = write_beside(out, photos.views)
    print_message(f"the cameras are in {cameras}: edit, render and preview use them")
    frame = None if start is None else copy_export_frame(start, out)
    frame = frame or write_export_frame(photos, dataset, out)
    if frame is not None:
        print_message(f"{frame} says how to get back to the frame of the photos (docs/data.md)")


def with_budget(
    values: Values, minutes: float | None, settings: FitSettings | None = None
) -> FitSettings:
    """The settings of a fit, the defaults where None is given. A budget of steps or of time lifts
    the other that they have."""
    from gsedit.fitting.settings import FitSettings

    budget = {}
    if minutes is not None or ("steps",) in values:
        budget = {("seconds",): minutes and 60 * minutes}
    return with_values(settings or FitSettings(), {**values, **budget})


def print_fit(result: FitResult, out: Path, *, as_json: bool) -> None:
    """Print what the fit came to."""
    print_message(
        f"{len(result.scene)} Gaussians, {result.psnr:.2f} dB on held-out photos, "
        f"{result.steps} steps in {result.seconds:.0f} s; look: gsedit preview {out}"
    )
    record = {
        "scene": out,
        "gaussians": len(result.scene),
        "psnr": result.psnr,
        "steps": result.steps,
        "seconds": result.seconds,
        "curve": result.curve,
    }
    print_result(record, str(out), as_json=as_json)
