"""Error against run time: one knob at a time around the defaults, a row each."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench import measure
from gsedit.bench.measure import PIECES, Timing, timed
from gsedit.bench.renderer import pairs, peers
from gsedit.bench.renderer.accuracy import Drawn, Errors, differentiate, errors, truth_of
from gsedit.bench.renderer.rows import OURS, Row
from gsedit.bench.renderer.worker import Worker, WorkerError, peak_memory
from gsedit.bench.renderer.workloads import Workload
from gsedit.errors import UsageError
from gsedit.reports.events import Event
from rasterizer import Camera, Execution, Gaussians, Numerics, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.numerics import AUTO, DEFAULT
from rasterizer.reference import render_reference

BASELINE, PEERS = "baseline", "peers"


@dataclass(frozen=True)
class Setting:
    """A way to draw: the defaults, but for one knob."""

    knob: str = "default"
    value: str = ""
    numerics: Numerics = DEFAULT
    execution: Execution = AUTO
    dtype: torch.dtype = torch.float32
    degree: int | None = None
    """SH bands above this are left out."""
    resolution: float = 1.0
    """Side of the picture that is drawn and then enlarged (bilinear), of the side asked for."""
    textbook: bool = False
    """The reference's formula in this dtype instead of ours."""


@dataclass(frozen=True)
class Plan:
    """What is measured, and how often."""

    knobs: tuple[str, ...]
    runs: int = 5
    quick: bool = False
    """Two values a knob: the first and the last."""
    budget: float = 2.5
    """Seconds after which a timing begins no further run."""
    pieces: int = PIECES
    """Of a yardstick pass."""


def _floors() -> list[Setting]:
    return [
        Setting("floor", f"{n:g}/255", numerics=replace(DEFAULT, alpha_min=n / 255))
        for n in (0.5, 2.0, 4.0, 16.0)
    ]


def _stops() -> list[Setting]:
    return [
        Setting("stop", f"{stop:g}", numerics=replace(DEFAULT, transmittance_min=stop))
        for stop in (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
        if stop != DEFAULT.transmittance_min
    ]


def _tiles() -> list[Setting]:
    sizes = (4, 8, 16, 32)
    return [Setting("tile", str(n), execution=replace(AUTO, tile_size=n)) for n in sizes]


def _blocks() -> list[Setting]:
    return [Setting("block", str(n), execution=replace(AUTO, block=n)) for n in (8, 16, 32, 64)]


def _resolutions() -> list[Setting]:
    return [Setting("resolution", f"{r:g}", resolution=r) for r in (0.25, 0.5, 0.71)]


KNOBS: dict[str, Callable[[], list[Setting]]] = {
    "floor": _floors,
    "stop": _stops,
    "tile": _tiles,
    "block": _blocks,
    "cull": lambda: [Setting("cull", "box", execution=replace(AUTO, cull="box"))],
    "compile": lambda: [Setting("compile", "yes", execution=replace(AUTO, compile=True))],
    "dtype": lambda: [Setting("dtype", "float64", dtype=torch.float64)],
    "degree": lambda: [Setting("degree", str(n), degree=n) for n in range(4)],
    "resolution": _resolutions,
    BASELINE: lambda: [Setting(BASELINE, "textbook conic", textbook=True)],
    PEERS: list,
}
"""Values to try, by knob. Degrees that a scene does not exceed are left out."""


def parse_knobs(text: str) -> tuple[str, ...]:
    """Knobs from names separated by commas. Raises UsageError for one that there is not."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    unknown = [name for name in names if name not in KNOBS]
    if unknown:
        raise UsageError(f"--knobs {text}: no knob {unknown[0]!r}; there are {', '.join(KNOBS)}")
    return names


def settings(knobs: Sequence[str], degree: int, *, quick: bool = False) -> list[Setting]:
    """The defaults and all values of the knobs, for a scene of that SH degree."""
    found = [Setting()]
    for knob in knobs:
        values = [s for s in KNOBS[knob]() if s.degree is None or s.degree < degree]
        found += [values[0], values[-1]] if quick and len(values) > 2 else values
    return found


def draw(setting: Setting, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
    """A picture as a setting says; differentiable."""
    if setting.degree is not None:
        scene = replace(scene, sh=scene.sh[:, : (setting.degree + 1) ** 2])
    if setting.textbook:
        return render_reference(scene, camera, dtype=setting.dtype).color
    drawn = reduced(camera, setting.resolution)
    color = render(scene, drawn, numerics=setting.numerics, execution=setting.execution).color
    if setting.resolution == 1:
        return color
    enlarged = torch.nn.functional.interpolate(
        color.permute(2, 0, 1)[None], (camera.height, camera.width), mode="bilinear",
        align_corners=False,
    )  # fmt: skip
    return enlarged[0].permute(1, 2, 0)


def reduced(camera: Camera, resolution: float) -> Camera:
    """The same view with fewer pixels."""
    if resolution == 1:
        return camera
    width, height = (max(1, round(n * resolution)) for n in (camera.width, camera.height))
    return camera.resized(width, height)


def sweep(
    workloads: Sequence[Workload], plan: Plan, cache: Path | None = None
) -> Iterator[Event | Row]:
    """Measure every workload at every setting: rows, and events that say what is going on.

    `cache` keeps the reference's pictures and gradients between runs.
    """
    began = perf_counter()
    found_peers, absent = peers.installed() if PEERS in plan.knobs else ([], [])
    if absent:
        yield Event("peers", 0.0, note=f"left out, not installed: {', '.join(absent)}")
    with Worker() as worker:
        for workload in workloads:
            listed = settings(plan.knobs, workload.scene.degree, quick=plan.quick)
            steps = len(listed) + len(found_peers)

            def event(step: int, note: str) -> Event:
                return Event(workload.name, perf_counter() - began, step, steps, note=note)  # noqa: B023

            yield event(0, "reference in float64")
            bench = _Bench(workload, plan, worker, truth_of(workload.scene, workload.camera, cache))
            step = 0
            for setting in listed:
                row = bench.row(setting)
                step += 1
                yield row
                yield event(step, row.label)
            for peer in found_peers:
                row = bench.peer_row(peer)
                step += 1
                yield row
                yield event(step, row.label)


class _Bench:
    """One workload, its truth, and what its rows have in common."""

    def __init__(self, workload: Workload, plan: Plan, worker: Worker, truth: Drawn) -> None:
        self.workload, self.plan, self.worker, self.truth = workload, plan, worker, truth
        self.counted: dict[tuple[Numerics, float], int] = {}

    def row(self, setting: Setting) -> Row:
        """Measure one way of drawing; an error becomes the row's note."""
        scene = self.workload.scene.to(setting.dtype)
        camera = self.workload.camera
        drawing = partial(draw, setting)
        shared = self.shared(setting)
        name = f"textbook conic {dtype_name(setting)}" if setting.textbook else OURS
        fields = {**shared, "implementation": name, "knob": setting.knob, "value": setting.value}
        try:
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                if setting.execution.compile:  # the compiler's time is not the kernel's
                    differentiate(drawing, scene, camera)
                with torch.no_grad():
                    forward, _ = self.timed(lambda: drawing(scene, camera))
                both, drawn = self.timed(lambda: differentiate(drawing, scene, camera))
        except (RuntimeError, ValueError, NotImplementedError) as error:
            return _row(fields, note=_line(f"{type(error).__name__}: {error}"))
        notes = list(dict.fromkeys(_line(str(warning.message)) for warning in warned))
        if setting.execution.compile and compiled.load() is None:  # it warns only once
            notes = ["no compiled kernel here: this is the eager one"]
        found = errors(drawn, self.truth)
        del drawn
        slow = both.wall > 2 * self.plan.budget  # not once more for its memory
        peak, missing = (None, "") if slow else self.peak(drawing, scene)
        return _row(fields, forward, both, found, peak, "; ".join(filter(None, (*notes, missing))))

    def timed(self, work: Callable[[], Any]) -> tuple[Timing, Any]:
        return timed(work, self.plan.runs, self.plan.budget, self.plan.pieces)

    def peak(self, drawing: Callable, scene: Gaussians) -> tuple[int | None, str]:
        """Peak memory of forward and backward, or why it is not known."""
        small = scene[:100]
        try:
            # libraries, threads and kernels that the first call loads are not the work's
            self.worker.call(differentiate, drawing, small, self.workload.camera.resized(8, 8))
            args = (differentiate, drawing, scene, self.workload.camera)
            return self.worker.call(peak_memory, *args), ""
        except WorkerError as error:
            return None, f"peak memory: {error}"

    def peer_row(self, peer: peers.Peer) -> Row:
        """Measure a peer in the other process: it may end that one."""
        fields = {
            **self.shared(Setting()),
            "implementation": peer.title(),
            "knob": PEERS,
            "value": peer.name,
        }
        args = (self.workload, self.plan.runs, self.plan.budget, self.plan.pieces)
        try:
            result: peers.Measured = self.worker.call(peers.measured, peer.name, *args)
        except WorkerError as error:
            return _row(fields, note=str(error))
        found = errors(result.drawn, self.truth)
        return _row(fields, result.forward, result.both, found, note=peer.remark)

    def shared(self, setting: Setting) -> dict[str, object]:
        """The fields of a row that do not have to be measured."""
        scene, camera = self.workload.scene, self.workload.camera
        drawn = reduced(camera, setting.resolution)
        numerics = setting.numerics
        tiled, evaluated = pairs.listed_pairs(scene, drawn, numerics, setting.execution)
        key = (numerics, setting.resolution)
        if key not in self.counted:
            self.counted[key] = pairs.contributing_pairs(scene, drawn, numerics)
        return {
            "scene": self.workload.name,
            "gaussians": len(scene),
            "width": drawn.width,
            "height": drawn.height,
            "pairs": tiled,
            "evaluated": evaluated,
            "contributing": self.counted[key],
            "dtype": dtype_name(setting),
            "threads": torch.get_num_threads(),
            "commit": measure.commit(),
            "machine": measure.machine(),
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        }


def dtype_name(setting: Setting) -> str:
    return str(setting.dtype).removeprefix("torch.")


def _row(
    fields: dict, forward: Timing | None = None, both: Timing | None = None,
    found: Errors | None = None, peak: int | None = None, note: str = "",
) -> Row:  # fmt: skip
    if found and not math.isfinite(found.mean):
        note = "; ".join(filter(None, (note, "the picture has NaN or infinite colours")))
    longest = both or forward
    return Row(
        **fields,
        runs=longest.runs if longest else 0,
        forward_wall=forward and forward.wall,
        forward_cpu=forward and forward.cpu,
        both_wall=both and both.wall,
        both_cpu=both and both.cpu,
        yardstick=longest and longest.yardstick,
        error_mean=found and found.mean,
        error_tail=found and found.tail,
        error_max=found and found.largest,
        gradient_error=found and found.gradient,
        gradient_cosine=found and found.cosine,
        peak_bytes=peak,
        note=note,
    )


def _line(text: str) -> str:
    return " ".join(text.split())[:300]
