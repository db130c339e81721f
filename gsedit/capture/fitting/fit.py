"""Gaussians from posed photos: coarse to fine, densified where the pictures disagree most.

The recipe is Kerbl et al. 2023 (3D Gaussian Splatting), shortened to the few thousand steps a CPU
can take.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import inf, sqrt
from statistics import fmean
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.densify import Densified, ScreenGradients, densify, without_floaters
from gsedit.capture.fitting.exposure import Exposures
from gsedit.capture.fitting.initial import initial_scene
from gsedit.capture.fitting.optimizer import SceneOptimizer, optimized_scene
from gsedit.capture.fitting.photometric import SMALLEST, photometric, supervised
from gsedit.capture.fitting.settings import LEAST_STEPS, FitSettings
from gsedit.errors import UsageError
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.formulas import psnr
from gsedit.pictures import notebook
from gsedit.run.events import Checkpoint, Event
from gsedit.run.json_lines import plain
from gsedit.run.state import State, check_same, digest_of, restoring, tensor_like
from gsedit.run.step_threads import StepThreads
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.framing import finest_pixels
from gsedit.views.dataset import Dataset, View
from gsedit.views.lazy_views import PixelCache
from rasterizer.blending.choose import is_compiled
from rasterizer.numerics import under
from rasterizer.render import render, render_picture
from rasterizer.scene import Gaussians


class Budget:
    """Counts `step` and runs from its construction; None: no limit of that kind.

    `step` and `spent` seconds were done before; seconds are the clock's.
    """

    def __init__(
        self,
        steps: int | None,
        seconds: float | None,
        *,
        step: int = 0,
        spent: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._steps, self._seconds = steps, seconds
        self._stopwatch = Stopwatch(spent, clock=clock)
        self.step = step

    @property
    def seconds(self) -> float:
        """Since the construction, with those spent before."""
        return self._stopwatch.seconds

    @property
    def progress(self) -> float:
        """Fraction of the budget that is spent: of the steps or of the seconds, the larger; 1 where
        the last step, or LEAST_STEPS, took longer."""
        by_step = 0.0 if self._steps is None else self.step / self._steps
        by_time = 0.0 if self._seconds is None else self.seconds / self._seconds
        return min(1.0, max(by_step, by_time))

    @property
    def finished(self) -> bool:
        """Whether all of it is spent, and LEAST_STEPS are done where there may be so many."""
        least = LEAST_STEPS if self._steps is None else min(LEAST_STEPS, self._steps)
        return self.progress >= 1 and self.step >= least

    @property
    def steps(self) -> int:
        """Expected number of steps in the whole budget."""
        return max(self.step, round(self.step / max(self.progress, 1e-9)))


RATES = {"means": 6.4e-4, "quats": 4e-3, "log_scales": 4e-2, "logit_opacities": 1e-1, "sh": 4e-2}
"""Learning rates by field; that of positions times the scene's radius. Colors, opacities and scales
move faster than in 3D Gaussian splatting: a fit here has a few thousand steps and not 30,000."""
FINAL_RATE = {"means": 0.02, "sh": 0.2, "log_scales": 0.3, "logit_opacities": 0.3, "quats": 0.3}
"""Each rate decays exponentially to this fraction at the end of the budget."""
FREE = ("checkpoint_seconds", "execution", "report_every")
"""Settings that may change when a fit goes on: they do not change the scene."""
PLAIN = ("order", "curve", "loss", "next_evaluation", "last_checkpoint", "started_with")
"""Names of the state of a fit that is no tensor."""
SWEEP_SHARE = 0.25
"""Share of the budget's seconds after which the plane sweep of the start ends: 84 photos at 256
pixels take 3."""
EQUAL_PIXELS = 135_000
"""Pixels that take as much of a step as all that does not depend on their number: 150,000 Gaussians
of the bear take 17 ms a step at 128 pixels, 22 at 256 and 47 at 512 (two threads)."""
GROWTH_SHARE = 0.6
"""Share of the budget after which the number of Gaussians is left alone."""
FLOATERS_EVERY = 10
"""Densifications between two looks for floaters, each of which renders every photo small."""
CLEARED_AT = 128
"""Longer side, pixels, of the pictures in which floaters are looked for."""
LOSS_DECAY = 0.95
"""Decay per step of the running mean of the loss that events report."""


@dataclass(frozen=True, eq=False)
class FitResult:
    """Result of a fit: the scene and its measurements."""

    scene: Gaussians
    psnr: float
    """Mean over the held-out views, dB."""
    steps: int
    seconds: float
    curve: tuple[tuple[float, float], ...]
    """(seconds, held-out dB) at every evaluation."""

    def __repr__(self) -> str:
        return f"FitResult({self.scene!r}, {self.psnr:.1f} dB, {self.steps} steps)"

    def _repr_png_(self) -> bytes | None:
        """Picture that a notebook shows."""
        return notebook.attempt(lambda: notebook.scene_png(self.scene))

    def _repr_html_(self) -> str | None:
        """Picture and measurements for a notebook."""
        rows = {
            "held-out PSNR": notebook.decibels(self.psnr),
            "steps": f"{self.steps:,}",
            "seconds": f"{self.seconds:.0f}",
        }
        return notebook.attempt(
            lambda: notebook.as_html("Fit", rows, notebook.scene_png(self.scene))
        )


def fit_steps(
    dataset: Dataset,
    settings: FitSettings | None = None,
    *,
    generator: torch.Generator,
    start: Gaussians | None = None,
    resume: State | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Event | Checkpoint | FitResult]:
    """Fit a scene; yields progress, checkpoints now and then, and last the result.

    Every 8th view is never trained on. The budget's seconds are the clock's. With the state of a
    checkpoint, the same fit goes on from there, with what is left of its budget. Raises UsageError
    if there is nothing to train on, for photos that are too small, and for the state of another
    fit.
    """
    settings = settings or FitSettings()
    steps = _fit_steps(dataset, settings, generator, start, resume, clock)
    return under(settings.execution, steps)


def _fit_steps(
    dataset: Dataset,
    settings: FitSettings,
    generator: torch.Generator,
    start: Gaussians | None,
    resume: State | None,
    clock: Callable[[], float],
) -> Generator[Event | Checkpoint | FitResult, None, None]:
    """`fit_steps`, under the execution that rules."""
    train, held_out = dataset.split()
    if not train:
        raise UsageError(
            f"{len(dataset)} view(s) are too few to fit: every 8th is held out; add photos"
        )
    check_sizes(dataset.views, settings)
    asked = requested(dataset, settings, generator, start)
    if resume is not None:
        with restoring(resume):
            check_same(asked, resume.record["request"], "fit")
            start = optimized_scene(resume.within("optimizer"))
    done = (
        {} if resume is None else {"step": resume.record["step"], "spent": resume.record["seconds"]}
    )
    # it runs from here on: the start from the photos is part of it
    budget = Budget(settings.steps, settings.seconds, clock=clock, **done)
    if start is None:
        start = _start(dataset, settings, generator, budget)
    extent = _camera_extent(dataset.views)
    work = _Fit(start, train, held_out, extent, settings, generator, asked, budget)
    del start  # the optimizer has copies
    if resume is not None:
        with restoring(resume):
            work.load_state(resume)
    threads = StepThreads()
    while not work.budget.finished:
        with threads.step():
            work.step()
        work.densify_if_due()
        yield from work.report()
        yield from work.checkpoint_if_due()
    yield from work.finish()


def fit(
    dataset: Dataset,
    settings: FitSettings | None = None,
    *,
    generator: torch.Generator | None = None,
    start: Gaussians | None = None,
) -> FitResult:
    """`fit_steps` to the end."""
    generator = generator or torch.Generator().manual_seed(0)
    steps = fit_steps(dataset, settings, generator=generator, start=start)
    last = deque(steps, maxlen=1).pop()  # checkpoints are whole scenes: none is kept
    assert isinstance(last, FitResult)
    return last


def evaluate(scene: Gaussians, views: tuple[View, ...]) -> float:
    """Mean PSNR over views, dB, where their masks are True; infinite where all are equal.

    A view that is masked throughout does not count. Raises UsageError where all are.
    """
    views = tuple(view for view in views if view.mask is None or view.mask.any())
    if not views:
        raise UsageError("the masks hide every held-out photo: give masks that leave some pixels")

    return fmean(psnr(render_picture(scene, v.camera), v.image, v.mask) for v in views)


class _Fit:
    """A fit in progress: the one place with state."""

    def __init__(
        self, scene: Gaussians, train: tuple[View, ...], held_out: tuple[View, ...],
        extent: float, settings: FitSettings, generator: torch.Generator, asked: dict[str, Any],
        budget: Budget,
    ) -> None:  # fmt: skip
        self.asked, self.budget = asked, budget
        self.settings, self.generator, self.held_out = settings, generator, held_out
        self.batch = settings.batch
        rates = {**RATES, "means": RATES["means"] * extent}
        rates = {name: rate * sqrt(self.batch) for name, rate in rates.items()}
        compiled = is_compiled(settings.execution)
        self.optimizer = SceneOptimizer(scene, rates, compiled=compiled)
        self.pyramid = pyramid(train, (pixels for _, pixels in settings.coarse))
        self.costs = {  # of a step on one of these views, in that of a step on no pixels
            side: 1 + fmean(v.camera.width * v.camera.height for v in views) / EQUAL_PIXELS
            for side, views in self.pyramid.items()
        }
        self.work, self.began = 0.0, budget.seconds
        self.gradients = ScreenGradients(len(scene))
        self.started_with = len(scene)
        self.exposures = Exposures(train, settings.exposure)
        self.cameras = [view.camera for view in train]
        self.pixels = finest_pixels(scene.means, self.cameras)
        self.order: list[int] = []
        self.curve: list[tuple[float, float]] = []
        self.loss: float | None = None
        self.next_evaluation, self.last_checkpoint = 0.0, 0.0

    def state(self) -> State:
        """All that changes during a fit; the tensors are the fit's own."""
        tensors = {f"optimizer.{name}": each for name, each in self.optimizer.state().items()}
        tensors |= {f"gradients.{name}": each for name, each in self.gradients.state().items()}
        tensors |= {f"exposures.{name}": each for name, each in self.exposures.state().items()}
        tensors |= {"generator": self.generator.get_state(), "pixels": self.pixels}
        record = {
            "request": self.asked,
            "step": self.budget.step,
            "seconds": self.budget.seconds,
            **{name: getattr(self, name) for name in PLAIN},
        }
        return State(record, tensors)

    def load_state(self, state: State) -> None:
        """Go on where the fit was that was interrupted."""
        record = state.record
        self.optimizer.load_state(state.within("optimizer"))
        self.gradients.load_state(state.within("gradients"))
        self.exposures.load_state(state.within("exposures"))
        now = self.generator.get_state()
        self.generator.set_state(tensor_like(state.tensors, "generator", now))
        self.pixels = tensor_like(state.tensors, "pixels", self.pixels)
        for name in PLAIN:
            setattr(self, name, record[name])
        if not set(self.order) <= set(range(len(self.pyramid[None]))):
            raise ValueError("its order names photos that are not there")
        self.curve = [(seconds, decibels) for seconds, decibels in record["curve"]]

    def step(self) -> None:
        """One optimizer step on a batch of photos."""
        optimizer, scene = self.optimizer, self.optimizer.scene
        # in front of a random color, every hole in the scene costs where the photo is opaque
        photos = [
            (self._next_view(), torch.rand(3, generator=self.generator)) for _ in range(self.batch)
        ]
        seen, loss = ScreenGradients(len(scene)), torch.zeros(())
        for view, background in photos:
            one = self._loss(scene, view, background)
            # called with the gradient of this photo alone, before it is added to that of the others
            hook = scene.means.register_hook(partial(seen.add, scene=scene, camera=view.camera))
            one.backward()
            hook.remove()
            loss += one.detach()
        self.exposures.move()
        self.gradients.include(seen)
        optimizer.step({k: v**self.budget.progress for k, v in FINAL_RATE.items()})
        optimizer.hold_shapes(self.pixels)
        self.budget.step += 1
        self.work += self.costs[self._level]
        mean = loss.item() / self.batch
        self.loss = mean if self.loss is None else LOSS_DECAY * self.loss + (1 - LOSS_DECAY) * mean

    def _loss(self, scene: Gaussians, view: View, background: Float[Tensor, "3"]) -> Tensor:
        """Loss of one photo."""
        settings = self.settings
        picture = render(scene, view.camera, background=background).color
        photo = view.over(background)
        picture = self.exposures.compensated(picture, view, photo)
        picture, photo = supervised(picture, photo, view.mask)
        compiled = is_compiled(settings.execution)
        return photometric(picture, photo, settings.dssim_weight, compiled=compiled)

    def _next_view(self) -> View:
        """A photo as coarse as the budget says; each once in a random order, then anew."""
        views = self.pyramid[self._level]
        if not self.order:
            self.order = torch.randperm(len(views), generator=self.generator).tolist()
        return views[self.order.pop()]

    @property
    def _level(self) -> int | None:
        """The key of the pictures in `pyramid` that are trained on now."""
        return next((side for f, side in self.settings.coarse if self.budget.progress < f), None)

    @property
    def _seconds_left(self) -> float | None:
        """To the end of the steps: their number on each level, times its cost, at the pace so far;
        None before the first."""
        steps, begin, work = self.settings.steps, self.budget.progress, 0.0
        if steps is None or not self.work:
            return None
        for end, side in (*self.settings.coarse, (1.0, None)):
            work += max(0.0, end - begin) * steps * self.costs[side]
            begin = max(begin, end)
        return work * (self.budget.seconds - self.began) / self.work

    def densify_if_due(self) -> None:
        """Densify every so many steps, and find floaters every so many times."""
        settings, budget = self.settings, self.budget
        if budget.step % settings.densify_every:
            return
        if budget.progress < GROWTH_SHARE:
            scene, gradients = self.optimizer.scene.detach(), self.gradients.mean
            self._replace(densify(scene, gradients, self._gaussians_due()))
        if not budget.step % (FLOATERS_EVERY * settings.densify_every):
            self._replace(self._cleared())
        self.pixels = finest_pixels(self.optimizer.scene.means.detach(), self.cameras)

    def _replace(self, other: Densified) -> None:
        self.optimizer.replace(*other)
        self.gradients = ScreenGradients(len(other.scene))

    def _cleared(self) -> Densified:
        small = [camera.fitted(CLEARED_AT) for camera in self.cameras]
        return without_floaters(self.optimizer.scene.detach(), small)

    def _gaussians_due(self) -> int:
        """How many there are to be by now: from the start's number evenly to the limit."""
        most, grown = self.settings.max_gaussians, self.budget.progress / GROWTH_SHARE
        return min(most, round(self.started_with + grown * (most - self.started_with)))

    def report(self) -> Iterator[Event]:
        """A measurement on the held-out views if one is due, otherwise the loss now and then."""
        budget, every = self.budget, self.settings.evaluations
        if budget.progress >= self.next_evaluation and not budget.finished:
            self.next_evaluation = (int(budget.progress * every) + 1) / every
            yield self._measure(self.optimizer.scene.detach())
        elif budget.step % self.settings.report_every == 0:
            yield self._event("fit", f"{len(self.optimizer.scene):,} Gaussians")

    def checkpoint_if_due(self) -> Iterator[Checkpoint]:
        """The scene as it is, every so many seconds."""
        seconds = self.budget.seconds
        if seconds - self.last_checkpoint > self.settings.checkpoint_seconds:
            self.last_checkpoint = seconds
            copied = lambda: self.optimizer.scene.detach().map(torch.clone)  # noqa: E731
            yield Checkpoint(self.state(), self.budget.step, seconds, copied)

    def finish(self) -> Iterator[Event | FitResult]:
        """The last measurement, and the result."""
        scene = self._cleared().scene
        yield self._measure(scene)
        steps, seconds = self.budget.step, self.budget.seconds
        yield FitResult(scene, self.curve[-1][1], steps, seconds, tuple(self.curve))

    def _measure(self, scene: Gaussians) -> Event:
        decibels = evaluate(scene, self.held_out)
        self.curve.append((self.budget.seconds, decibels))
        note = f"{len(scene):,} Gaussians, {decibels:.2f} dB"
        return self._event("measure", note, rmse_from_psnr(decibels))

    def _event(self, stage: str, note: str, error: float | None = None) -> Event:
        budget = self.budget
        place = (stage, budget.seconds, budget.step, budget.steps)
        return Event(*place, self.loss, error, note, self._seconds_left)


def _start(
    dataset: Dataset, settings: FitSettings, generator: torch.Generator, budget: Budget,
) -> Gaussians:  # fmt: skip
    """Start of a fit that is given no scene."""
    return initial_scene(
        dataset,
        settings.sh_degree,
        generator,
        swept=settings.dense_start,
        at_most=settings.max_gaussians,
        out_of_time=lambda: budget.seconds > SWEEP_SHARE * (settings.seconds or inf),
    )


def check_sizes(views: Sequence[View], settings: FitSettings) -> None:
    """Raise UsageError for a photo that is too small for the loss."""
    small = min(views, key=lambda view: min(view.camera.width, view.camera.height))
    width, height = small.camera.width, small.camera.height
    if settings.dssim_weight and min(width, height) < SMALLEST:
        raise UsageError(
            f"{small.name} has {width}x{height} pixels, and SSIM needs {SMALLEST} a side: fit to "
            "larger photos, or give --set dssim_weight=0"
        )


def pyramid(views: Sequence[View], sides: Iterable[int]) -> dict[int | None, tuple[View, ...]]:
    """By longer side in pixels: the views no larger than that, made when they are first needed;
    by None: as they are. A view whose coarse picture would be too small for the loss stays."""
    kept = PixelCache()
    coarse = {side: tuple(_coarse(view, side, kept) for view in views) for side in sides}
    return {None: tuple(views), **coarse}


def _coarse(view: View, side: int, kept: PixelCache) -> View:
    small = view.camera.fitted(side)
    if min(small.width, small.height) < SMALLEST:
        return view
    return kept.resized(view, small.width, small.height)


def requested(
    dataset: Dataset, settings: FitSettings, generator: torch.Generator, start: Gaussians | None
) -> dict[str, Any]:
    """Request as JSON: a fit resumes where this is the same."""
    cameras = [view.camera for view in dataset.views]
    poses = torch.stack([camera.world_to_camera.double() for camera in cameras])
    lenses = torch.tensor([[c.fx, c.fy, c.cx, c.cy] for c in cameras], dtype=torch.float64)
    fields = () if start is None else vars(start).values()
    pixels = chain.from_iterable(_levels(view) for view in dataset.views)
    return {
        "photos": f"{len(dataset)}, the first of {cameras[0].width}x{cameras[0].height}, "
        + digest_of(chain([poses, lenses.round(decimals=6)], pixels)),
        "settings": {name: v for name, v in plain(settings).items() if name not in FREE},
        "from": None if start is None else f"{len(start)} Gaussians, {digest_of(fields)}",
        "seed": generator.initial_seed(),
    }


def _levels(view: View) -> list[Tensor]:
    """All that a photo says, in 8 bits."""
    given = (view.image, view.alpha)
    levels = [(255 * each).round().byte() for each in given if each is not None]
    return levels if (mask := view.mask) is None else [*levels, mask]


def _camera_extent(views: tuple[View, ...]) -> float:
    """1.1 times the largest distance of a camera from the cameras' mean: INRIA's extent."""
    centers = torch.stack([v.camera.center for v in views])
    return max(1e-3, 1.1 * float((centers - centers.mean(0)).norm(dim=-1).max()))
