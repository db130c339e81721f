"""Fit captures by both recipes under one budget of seconds, and measure them on held-out photos.

The recipes take turns on each capture. Measuring takes none of the budget of either; the fit's own
first measurement of itself, which it reports, and its start from the points are in its budget.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean as mean
from typing import NamedTuple

import torch

from gsedit.bench.results import commit, machine, markdown_table
from gsedit.capture.fitting.fit import FitResult, fit_steps
from gsedit.capture.fitting.settings import QUALITIES, FitSettings
from gsedit.errors import UsageError
from gsedit.measures.formulas import nearness, perceptual, ssim
from gsedit.run.events import Checkpoint, Event
from gsedit.run.json_lines import Journal
from gsedit.views.dataset import Dataset, View
from gsedit.views.load import load_dataset
from rasterizer.numerics import Execution, rule
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians
from research.figures import draw_errors
from research.fit import captures
from research.fit.clock import Clock, Moment
from research.fit.gsplat_recipe import gsplat_fit

ROWS, TABLE, PLOT = "fit.jsonl", "fit.md", "fit.png"
FILES = (ROWS, TABLE, PLOT)
OURS, GSPLAT = "gsedit", "gsplat, its own steps"


@dataclass(frozen=True)
class Provenance:
    """Fields that every measurement has."""

    threads: int
    """Number of torch's threads."""
    commit: str
    machine: str
    date: str
    """Date and time, ISO 8601, UTC."""

    def __str__(self) -> str:
        return f"{self.date}, commit {self.commit}, {self.machine}, {self.threads} threads."


def provenance() -> Provenance:
    """Provenance of a measurement that is taken now."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return Provenance(torch.get_num_threads(), commit(), machine(), date)


@dataclass(frozen=True)
class FitMeasurement:
    """Result of a recipe on a capture at a moment."""

    capture: str
    recipe: str
    seconds: float
    steps: int
    gaussians: int
    psnr: float
    ssim: float
    perceptual: float | None
    provenance: Provenance


class Quality(NamedTuple):
    """Means over held-out photos."""

    psnr: float
    """Peak signal-to-noise ratio, dB."""
    ssim: float
    perceptual: float | None
    """None: the package is not installed, or the pictures are too small."""


@dataclass(frozen=True)
class BenchSettings:
    """Captures to fit, recipes and their budgets."""

    datasets: tuple[Path, ...] = ()
    """Folders of posed photos, beside the synthetic captures."""
    synthetic: int = 2
    """Synthetic captures, at most 2."""
    seconds: float = 90.0
    """The budget of each fit."""
    moments: int = 5
    """At which a fit is measured, the last at its end."""
    size: int = 256
    """Longer side of the photos, pixels."""
    views: int = 40
    """Photos of a synthetic capture."""
    seed: int = 0
    fit: FitSettings = QUALITIES["draft"].settings
    """Settings of our recipe; its budget is `seconds`."""

    @property
    def execution(self) -> Execution:
        """Both recipes render with it."""
        return self.fit.execution


@torch.no_grad()
def measure(scene: Gaussians, views: Sequence[View], execution: Execution) -> Quality:
    """Error, structure and perceptual distance of renders, clamped to [0, 1], to photos; masked
    pixels do not count."""
    rule(execution)
    shown = [view for view in views if view.mask is None or view.mask.any()]
    pairs = [(render_picture(scene, view.camera), view.image, view.mask) for view in shown]
    distances = [each for pair in pairs if (each := perceptual(*pair)) is not None]
    return Quality(
        mean(nearness(*pair) for pair in pairs),
        mean(ssim(*pair) for pair in pairs),
        mean(distances) if distances else None,
    )


def our_fit(data: Dataset, settings: BenchSettings, clock: Callable[[], float]) -> Iterator[Moment]:
    """`gsedit fit` under the budget, at its moments."""
    own = replace(
        settings.fit,
        steps=None,
        seconds=settings.seconds,
        evaluations=1,
        checkpoint_seconds=settings.seconds / settings.moments,
    )
    generator = torch.Generator().manual_seed(settings.seed)
    for item in fit_steps(data, own, generator=generator, clock=clock):
        if isinstance(item, Checkpoint) and clock() < settings.seconds:
            yield Moment(clock(), item.step, item.scene)
        elif isinstance(item, FitResult):
            yield Moment(clock(), item.steps, item.scene)


def fits(
    name: str,
    data: Dataset,
    recipe: str,
    settings: BenchSettings,
    read: Callable[[], float] = time.monotonic,
) -> Iterator[FitMeasurement]:
    """One fit, measured while its clock stands. `read`: seconds, of the wall or of a processor."""
    held_out = data.split()[1]
    for view in data.views:
        _ = view.image  # read, and kept: the first recipe would pay for it
    clock, now = Clock(read), provenance()
    if recipe == OURS:
        steps = our_fit(data, settings, clock)
    else:
        steps = gsplat_fit(
            data,
            settings.seconds,
            moments=settings.moments,
            clock=clock,
            generator=torch.Generator().manual_seed(settings.seed),
            execution=settings.execution,
        )
    for moment in steps:
        with clock.paused():
            quality = measure(moment.scene, held_out, settings.execution)
            yield FitMeasurement(
                name, recipe, moment.seconds, moment.steps, len(moment.scene), *quality, now
            )


def load_captures(settings: BenchSettings, folder: Path) -> Iterator[tuple[str, Dataset]]:
    """The datasets, then the synthetic captures, whose photos are kept in the folder.

    Raises UsageError for a dataset without points, before anything is fitted.
    """
    given = [(path, load_dataset(path, size=settings.size)) for path in settings.datasets]
    for path, data in given:
        if data.points is None:
            raise UsageError(
                f"{path} has no sparse points, from which gsplat's recipe starts: leave it out"
            )
    yield from ((path.name, data) for path, data in given)
    for scene in captures.rooms()[: settings.synthetic]:
        kept = folder / f"{scene.name} {settings.views}x{settings.size}".replace(" ", "-")
        if not (kept / "transforms.json").is_file():
            data = captures.photographed(scene, settings.views, settings.size)
            captures.write_dataset(data, kept)
        yield scene.name, load_dataset(kept)


def to_folder(
    settings: BenchSettings, folder: Path, read: Callable[[], float] = time.monotonic
) -> Iterator[Event | FitMeasurement]:
    """All fits, written to a folder: ROWS meanwhile, then TABLE and PLOT."""
    rows: list[FitMeasurement] = []
    journal = Journal(folder / ROWS, records=rows)  # an interruption loses no measurement
    for item in _all(settings, folder, read):
        if not isinstance(item, Event):
            journal.write(item)
        yield item
    (folder / TABLE).write_text(table(rows) + "\n", encoding="utf-8")
    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for row in rows:
        line = panels.setdefault(row.capture, {}).setdefault(row.recipe, [])
        line.append((row.seconds, row.psnr))
    draw_errors(panels, folder / PLOT, cost="seconds", error="PSNR, dB", logarithmic=False)


def _all(
    settings: BenchSettings, folder: Path, read: Callable[[], float]
) -> Iterator[Event | FitMeasurement]:
    began = time.monotonic()
    yield Event("photos", 0.0, note="synthetic photos are traced where they are not there yet")
    for name, data in load_captures(settings, folder / "captures"):
        for recipe in (OURS, GSPLAT):
            for row in fits(name, data, recipe, settings, read):
                yield row
                note = f"{name}, {recipe}: {row.psnr:.2f} dB at {row.seconds:.0f} s"
                yield Event("fit", time.monotonic() - began, note=note)


def table(rows: Sequence[FitMeasurement]) -> str:
    """Markdown: a line a moment."""
    head = ("capture, recipe", "s", "steps", "Gaussians", "PSNR, dB", "SSIM", "perceptual")
    lines = [
        (
            f"{row.capture}, {row.recipe}",
            f"{row.seconds:.0f}",
            f"{row.steps:,}",
            f"{row.gaussians:,}",
            f"{row.psnr:.2f}",
            f"{row.ssim:.3f}",
            "" if row.perceptual is None else f"{row.perceptual:.3f}",
        )
        for row in rows
    ]
    return markdown_table(head, lines)
