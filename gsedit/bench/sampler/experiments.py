"""What a sampler's accuracy costs: solvers on stiff problems, ways of agreeing, and our own loop.

Errors are against the exact path of the ODE (see sampler_problems), in units of the data's standard
deviation. Agreement is told with what it may not cost: contrast, and the edit itself.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial
from itertools import chain, product

import torch
from torch import Tensor

from gsedit.bench.measure import QUICK_PIECES, commit, machine, timed, timed_together
from gsedit.bench.sampler.problems import (
    Network,
    Problem,
    Scene,
    network,
    picture_scene,
    problem,
    start,
    texture_scene,
    truth,
)
from gsedit.bench.sampler.rows import SamplerRow
from gsedit.diffusion import (
    Need,
    NoiseLevel,
    SamplerSettings,
    Schedule,
    Solver,
    karras_sigmas,
    levels_of,
    sample,
)
from gsedit.diffusion.machine import InBfloat16, has_bfloat16, relative_error
from gsedit.errors import UsageError
from gsedit.reports.events import Event

SOLVERS: tuple[Solver, ...] = ("ddim", "heun", "dpm++2m")
WIDTHS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
GUIDANCE = (1.0, 7.5, 30.0)
STEPS = (5, 10, 20, 40, 80, 160, 320)
FIRST = Schedule.scaled_linear().level(999).sigma
GONE = 10.0
"""Of the data's standard deviation: a result farther from the truth has left the data."""


def measure(*, quick: bool = False, runs: int = 5) -> Iterator[Event | SamplerRow]:
    """All studies, one row after the other, an event before each. `quick`: fewer and shorter."""
    studies = chain(
        solver_rows(
            *((WIDTHS[::4], GUIDANCE[:2], STEPS[:4]) if quick else (WIDTHS, GUIDANCE, STEPS))
        ),
        stiff_rows((1, 20) if quick else (1, 2, 20, 1000)),
        consensus_rows(1 if quick else 3),
        cost_rows(runs),
    )
    began = time.perf_counter()
    for count, row in enumerate(studies, start=1):
        note = f"{row.problem}: {row.variant}, {row.steps} steps"
        yield Event("sampler", time.perf_counter() - began, count, note=note)
        yield _signed(row)


def _signed(row: SamplerRow) -> SamplerRow:
    date = datetime.now(timezone.utc).isoformat(timespec="seconds")
    threads = torch.get_num_threads()
    return replace(row, threads=threads, commit=commit(), machine=machine(), date=date)


# --- solvers ---


def fine_schedule(last: float, steps: int = 1000) -> Schedule:
    """Unit power, sigmas evenly spaced in their logarithm from `last` to Stable Diffusion's."""
    logs = torch.linspace(math.log(last), math.log(FIRST), steps, dtype=torch.float64)
    return Schedule(1 / (1 + (2 * logs).exp()))


def last_sigma(width: float) -> float:
    """Where the solver studies stop: a hundredth of the width, so that all of it is resolved."""
    return width / 100


def solver_rows(
    widths: Iterable[float], guidance: Iterable[float], steps: Iterable[int], runs: int = 3
) -> Iterator[SamplerRow]:
    """Each solver's distance from the ODE's path, per stiffness and number of steps."""
    counts = tuple(steps)
    for width, scale in product(widths, guidance):
        end = last_sigma(width)
        model = problem(width, schedule=fine_schedule(end))
        settings = SamplerSettings(
            guidance_text=scale, guidance_image=1.0 if scale == 1 else 1.5, strength=1.0
        )
        first = model.schedule.level_at(FIRST)
        x = start(model, first)
        answer = truth(model, x, first, settings, end)
        for solver, count in product(SOLVERS, counts):
            # half the steps, as many evaluations: what costs as much stands side by side
            many = max(count // 2, 1) if solver == "heun" else count
            chosen = replace(settings, solver=solver)
            levels = [model.schedule.level_at(s) for s in karras_sigmas(FIRST, end, many + 1)]

            work = partial(_last, model, x, chosen, levels)
            timing, found = timed(work, runs, pieces=1)
            error = None if found is None else _rms(found / levels[-1].a - answer)
            asked = many * (2 if solver == "heun" else 1)
            name = f"width {width:g}, guidance {scale:g}"
            yield SamplerRow(
                "solver", name, solver, many, asked, timing.wall, timing.yardstick, error=error
            )


def _last(
    model: Problem, x: Tensor, settings: SamplerSettings, levels: list[NoiseLevel]
) -> Tensor | None:
    """The result, or None where the sampler refused to go on."""
    try:
        generator = torch.Generator().manual_seed(0)
        *_, state = sample(model, None, x, settings, levels=levels, generator=generator)
    except UsageError:
        return None
    return state.x


def stiff_rows(steps: Iterable[int]) -> Iterator[SamplerRow]:
    """What each solver makes of extremes on Stable Diffusion's own levels, in float32.

    The error is the distance from the nearest component of the data: 0 to a few widths is right.
    """
    plain, terminal = Schedule.scaled_linear(), Schedule.scaled_linear().zero_terminal_snr()
    solvers: tuple[Solver, ...] = (*SOLVERS, "ancestral")
    for count, width, scale, solver in product(steps, WIDTHS[::2], GUIDANCE, solvers):
        yield _stiff_row(count, solver, width, scale, plain)
    for scale, solver in product(GUIDANCE, solvers):
        yield _stiff_row(20, solver, 1e-2, scale, terminal)
    for dtype, scale, solver in product((torch.bfloat16, torch.float16), GUIDANCE, solvers):
        yield _stiff_row(20, solver, 1e-2, scale, plain, dtype)


def _stiff_row(
    count: int,
    solver: Solver,
    width: float,
    scale: float,
    schedule: Schedule,
    dtype: torch.dtype | None = None,
) -> SamplerRow:
    terminal = schedule.alpha(999) == 0
    model = problem(width, schedule=schedule, dtype=dtype, predicts="v" if terminal else "eps")
    settings = SamplerSettings(
        steps=count, guidance_text=scale, guidance_image=1.0 if scale == 1 else 1.5,
        strength=1.0, solver=solver, spacing="trailing",
    )  # fmt: skip
    levels = levels_of(schedule, settings)
    x = start(model, levels[0], dtype=torch.float32)
    began = time.perf_counter()
    found = _last(model, x, settings, levels)
    seconds = time.perf_counter() - began
    asked = 2 * count - 1 if solver == "heun" else count
    network = "" if dtype is None else f", {str(dtype).removeprefix('torch.')} network"
    name = f"width {width:g}, guidance {scale:g}{', terminal SNR 0' * terminal}{network}"
    if found is None:
        return SamplerRow("stiff", name, solver, count, asked, seconds, note="refused")
    distance = (found.double() - model.told.offsets).flatten(2).square().mean(-1).sqrt().amin(0)
    error = float(distance.max())
    note = "left the data" if error > GONE else ""
    return SamplerRow("stiff", name, solver, count, asked, seconds, error=error, note=note)


# --- consensus ---

VARIANTS: dict[str, dict[str, object]] = {
    "none, independent noise": {"consensus": False, "noise": "independent"},
    "none, shared noise": {"consensus": False},
    "xt, independent (paper)": {"target": "xt", "noise": "independent"},
    "xt, shared": {"target": "xt"},
    "x0, independent": {"noise": "independent"},
    "x0, shared (default)": {},
    "x0, shared, half strength": {"consensus_strength": 0.5},
    "eps, shared": {"target": "eps"},
    "x0, shared, heun": {"solver": "heun"},
    "x0, shared, dpm++2m": {"solver": "dpm++2m"},
    "x0, shared, ancestral": {"solver": "ancestral"},
}
SWEPT = ("xt, independent (paper)", "x0, shared (default)", "xt, shared")
SWEEP_STEPS, SWEEP = 50, (0, 10, 20, 30, 40, 50)
"""As in the paper, whose figure has T_end from 10 to 50 of them."""


def consensus_rows(
    seeds: int, scenes: Iterable[Scene] | None = None, sweep: Iterable[int] = SWEEP
) -> Iterator[SamplerRow]:
    """Every way of agreeing at 20 steps, then the sweep of T_end; means over seeds."""
    sweep = tuple(sweep)
    for scene in scenes or (texture_scene(), picture_scene()):
        alone = _agreement(scene, {"consensus": False, "noise": "independent"}, seeds, None)
        for variant, options in VARIANTS.items():
            yield _agreement(scene, {"steps": 20, **options}, seeds, alone, variant)
        for variant, kept in product(SWEPT, sweep):
            options = {
                **VARIANTS[variant], "steps": SWEEP_STEPS, "strength": 1.0,
                "consensus": kept > 0, "t_end": 1 - kept / SWEEP_STEPS,
            }  # fmt: skip
            row = _agreement(scene, options, seeds, alone, variant)
            yield replace(row, t_end=float(kept), problem=f"{scene.name}, T_end")


def _agreement(
    scene: Scene,
    options: dict[str, object],
    seeds: int,
    alone: SamplerRow | None,
    variant: str = "",
) -> SamplerRow:
    settings = SamplerSettings(**options)  # pyright: ignore[reportArgumentType]
    began = time.perf_counter()
    results = [scene.edit(settings, seed) for seed in range(seeds)]
    seconds = (time.perf_counter() - began) / seeds
    contrast = sum(float(x.flatten(1).std(1).mean()) for x in results) / seeds
    return SamplerRow(
        "consensus",
        scene.name,
        variant,
        settings.steps,
        settings.steps * (2 if settings.solver == "heun" else 1),
        seconds,
        disagreement=sum(scene.disagreement(x) for x in results) / seeds,
        contrast=contrast / alone.contrast if alone and alone.contrast else contrast,
        strength=sum(_rms(x - scene.originals) for x in results) / seeds,
    )


# --- cost ---


def cost_rows(runs: int) -> Iterator[SamplerRow]:
    """Our loop against bare calls of the same network, and bfloat16 against float32."""
    model = network()
    x = torch.randn(2, 4, 32, 32, generator=torch.Generator().manual_seed(0))
    for solver in SOLVERS:
        settings = SamplerSettings(steps=10, solver=solver, spacing="linspace")
        levels = levels_of(model.schedule, settings)
        times = [level.t for level in levels[:-1]]
        if solver == "heun":
            times += times[1:]
        works = {"loop": _drain(model, x, settings), "bare": _bare(model, x, times)}
        found, _ = timed_together(works, runs, pieces=QUICK_PIECES)
        loop, bare = found["loop"], found["bare"]
        yield SamplerRow(
            "cost", "loop over bare network calls", solver, 10, len(times), loop.wall,
            loop.yardstick, overhead=loop.wall / bare.wall - 1,
        )  # fmt: skip
    settings = SamplerSettings(steps=10)
    rounded = InBfloat16(model)
    works = {"float32": _drain(model, x, settings), "bfloat16": _drain(rounded, x, settings)}
    found, results = timed_together(works, runs, pieces=QUICK_PIECES)
    for name, timing in found.items():
        error = relative_error(results[name], results["float32"]) if name == "bfloat16" else None
        note = "" if has_bfloat16() else "this processor has no bfloat16"
        yield SamplerRow(
            "cost", "precision of the network", name, 10, 10, timing.wall, timing.yardstick,
            error=error, note=note if name == "bfloat16" else "",
        )  # fmt: skip
    for s_I, name in ((1.5, "three branches"), (1.0, "s_I = 1: two")):
        chosen = SamplerSettings(steps=10, guidance_image=s_I)
        timing, _ = timed_together({"": _drain(model, x, chosen)}, runs, pieces=QUICK_PIECES)
        one = timing[""]
        yield SamplerRow("cost", "branches", name, 10, 10, one.wall, one.yardstick)


def _drain(
    model: Network | InBfloat16, x: Tensor, settings: SamplerSettings
) -> Callable[[], Tensor]:
    def work() -> Tensor:
        *_, state = sample(model, None, x, settings)
        return state.x

    return work


def _bare(model: Network, x: Tensor, times: list[float]) -> Callable[[], None]:
    def work() -> None:
        for t in times:
            model.branches(x, t, None, Need())

    return work


def _rms(x: Tensor) -> float:
    return float(x.double().square().mean().sqrt())
