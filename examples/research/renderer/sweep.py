"""Error against run time: one knob at a time around the defaults, one measurement each."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from gsedit.bench.renderer.accuracy import Drawn, Errors, differentiate, errors, reference_of
from gsedit.bench.renderer.speed import Workload
from gsedit.bench.results import provenance
from gsedit.bench.timing import Timing, timed
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer import Gaussians
from rasterizer.blending.choose import choose_backend, is_compiled
from research.renderer.measurements import OURS, RenderMeasurement
from research.renderer.pairs import listed_pairs
from research.renderer.settings import Setting, draw, reduced, settings_of
from research.renderer.worker import Worker, WorkerError, peak_memory


@dataclass(frozen=True)
class SweepPlan:
    """Settings to measure, and how often."""

    knobs: tuple[str, ...]
    runs: int = 5
    quick: bool = False
    """Two values a knob: the first and the last."""
    budget: float = 2.5
    """Seconds after which a timing begins no further run."""


def sweep(
    workloads: Sequence[Workload], plan: SweepPlan, cache: Path | None = None
) -> Iterator[Event | RenderMeasurement]:
    """Measure every workload with every setting: measurements, and events that name the last one.

    `cache`: folder that keeps the reference's pictures and gradients between runs.
    """
    stopwatch = Stopwatch()
    with Worker() as worker:
        for workload in workloads:
            settings = settings_of(plan.knobs, workload.scene.degree, quick=plan.quick)

            def event(step: int, note: str) -> Event:
                return Event(workload.name, stopwatch.seconds, step, len(settings), note=note)  # noqa: B023

            yield event(0, "reference in float64")
            reference = reference_of(workload.scene, workload.camera, cache)
            bench = _WorkloadBench(workload, plan, worker, reference)
            for step, setting in enumerate(settings, start=1):
                measurement = bench.measure(setting)
                yield measurement
                yield event(step, measurement.label)


class _WorkloadBench:
    """Measures one workload; holds its reference."""

    def __init__(
        self, workload: Workload, plan: SweepPlan, worker: Worker, reference: Drawn
    ) -> None:
        self.workload, self.plan, self.worker, self.reference = workload, plan, worker, reference

    def measure(self, setting: Setting) -> RenderMeasurement:
        """Measure one way of drawing; an error becomes the measurement's note."""
        scene = self.workload.scene.to(setting.dtype)
        camera = self.workload.camera
        drawing = partial(draw, setting)
        name = f"textbook conic {setting.dtype_name}" if setting.textbook else OURS
        fields = self.fields(setting, name, setting.knob, setting.value)
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                if is_compiled(setting.execution):  # the compiler's time is not the kernel's
                    differentiate(drawing, scene, camera)
                with torch.no_grad():
                    forward, _ = self.timed(lambda: drawing(scene, camera))
                both, drawn = self.timed(lambda: differentiate(drawing, scene, camera))
        except (RuntimeError, ValueError, NotImplementedError) as error:
            return _measurement(fields, note=_one_line(f"{type(error).__name__}: {error}"))
        notes = list(dict.fromkeys(_one_line(str(warning.message)) for warning in caught))
        backend = choose_backend(setting.execution, scene.means.device, scene.means.dtype)
        if setting.execution.kernel == "auto" and backend.name != "cpp":
            notes.append("no compiled kernel here: torch rendered")
        wrong = errors(drawn, self.reference)
        del drawn
        slow = both.wall > 2 * self.plan.budget  # not once more for its memory
        peak, missing = (None, "") if slow else self.peak(drawing, scene)
        note = "; ".join(filter(None, (*notes, missing)))
        return _measurement(fields, forward, both, wrong, peak, note)

    def timed(self, work: Callable[[], Any]) -> tuple[Timing, Any]:
        """Timing and last result of a piece of work, as often as planned."""
        return timed(work, self.plan.runs, self.plan.budget)

    def peak(self, drawing: Callable, scene: Gaussians) -> tuple[int | None, str]:
        """Peak memory of forward and backward in bytes, or None and the reason."""
        small = scene[:100]
        try:
            # libraries, threads and kernels that the first call loads are not the work's
            self.worker.call(differentiate, drawing, small, self.workload.camera.resized(8, 8))
            args = (differentiate, drawing, scene, self.workload.camera)
            return self.worker.call(peak_memory, *args), ""
        except WorkerError as error:
            return None, f"peak memory: {error}"

    def fields(
        self, setting: Setting, implementation: str, knob: str, value: str
    ) -> dict[str, object]:
        """The fields of a measurement that are known before drawing."""
        scene = self.workload.scene
        camera = reduced(self.workload.camera, setting.resolution)
        numerics = setting.numerics
        tiled, evaluated = listed_pairs(scene, camera, numerics, setting.execution)
        return {
            "scene": self.workload.name,
            "implementation": implementation,
            "knob": knob,
            "value": value,
            "gaussians": len(scene),
            "width": camera.width,
            "height": camera.height,
            "pairs": tiled,
            "evaluated": evaluated,
            "dtype": setting.dtype_name,
            **asdict(provenance()),
        }


def _measurement(
    fields: dict, forward: Timing | None = None, both: Timing | None = None,
    wrong: Errors | None = None, peak: int | None = None, note: str = "",
) -> RenderMeasurement:  # fmt: skip
    if wrong and not math.isfinite(wrong.mean):
        note = "; ".join(filter(None, (note, "the picture has NaN or infinite colors")))
    longest = both or forward
    return RenderMeasurement(
        **fields,
        runs=longest.runs if longest else 0,
        forward_wall=forward and forward.wall,
        forward_cpu=forward and forward.cpu,
        both_wall=both and both.wall,
        both_cpu=both and both.cpu,
        error_mean=wrong and wrong.mean,
        error_tail=wrong and wrong.tail,
        error_max=wrong and wrong.largest,
        gradient_error=wrong and wrong.gradient,
        gradient_cosine=wrong and wrong.cosine,
        peak_bytes=peak,
        note=note,
    )


def _one_line(text: str) -> str:
    return " ".join(text.split())[:300]
