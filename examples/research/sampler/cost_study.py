"""Cost of the sampler's own loop, of the network's precision and of the branches of guidance."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.measure import QUICK_PIECES, timed, timed_together
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.precision import InBfloat16, has_bfloat16, relative_error
from gsedit.diffusion.sampler import levels_of, sample
from gsedit.diffusion.settings import SamplerSettings, Solver
from research.sampler.measurements import SamplerMeasurement
from research.sampler.network import UntrainedNetwork, untrained_network
from research.sampler.solver_study import SOLVERS

STEPS = 10


def cost_study(runs: int) -> Iterator[SamplerMeasurement]:
    """The sampler against bare calls of its network; bfloat16 against float32; two branches."""
    model = untrained_network()
    x = torch.randn(2, 4, 32, 32, generator=torch.Generator().manual_seed(0))
    for solver in SOLVERS:
        yield _overhead(model, x, solver, runs)
    yield from _precision(model, x, runs)
    for s_I, name in ((1.5, "three branches"), (1.0, "s_I = 1: two")):
        work = _sampling(model, x, SamplerSettings(steps=STEPS, guidance_image=s_I))
        timing, _ = timed(work, runs, pieces=QUICK_PIECES)
        yield SamplerMeasurement(
            "cost", "branches", name, STEPS, STEPS, timing.wall, timing.yardstick
        )


def _overhead(
    model: UntrainedNetwork, x: Float[Tensor, "v c y x"], solver: Solver, runs: int
) -> SamplerMeasurement:
    settings = SamplerSettings(steps=STEPS, solver=solver, spacing="linspace")
    times = [level.t for level in levels_of(model.schedule, settings)[:-1]]
    if solver == "heun":
        times += times[1:]
    works = {"loop": _sampling(model, x, settings), "bare": _bare_calls(model, x, times)}
    timings, _ = timed_together(works, runs, pieces=QUICK_PIECES)
    loop, bare = timings["loop"], timings["bare"]
    return SamplerMeasurement(
        "cost", "loop over bare network calls", solver, STEPS, len(times), loop.wall,
        loop.yardstick, overhead=loop.wall / bare.wall - 1,
    )  # fmt: skip


def _precision(
    model: UntrainedNetwork, x: Float[Tensor, "v c y x"], runs: int
) -> Iterator[SamplerMeasurement]:
    settings = SamplerSettings(steps=STEPS)
    works = {
        "float32": _sampling(model, x, settings),
        "bfloat16": _sampling(InBfloat16(model), x, settings),
    }
    timings, results = timed_together(works, runs, pieces=QUICK_PIECES)
    for name, timing in timings.items():
        rounded = name == "bfloat16"
        error = relative_error(results[name], results["float32"]) if rounded else None
        note = "this processor has no bfloat16" if rounded and not has_bfloat16() else ""
        yield SamplerMeasurement(
            "cost", "precision of the network", name, STEPS, STEPS, timing.wall, timing.yardstick,
            error=error, note=note,
        )  # fmt: skip


def _sampling(
    model: UntrainedNetwork | InBfloat16, x: Float[Tensor, "v c y x"], settings: SamplerSettings
) -> Callable[[], Tensor]:
    def work() -> Tensor:
        *_, state = sample(model, None, x, settings)
        return state.x

    return work


def _bare_calls(
    model: UntrainedNetwork, x: Float[Tensor, "v c y x"], times: list[float]
) -> Callable[[], None]:
    def work() -> None:
        for t in times:
            model.branches(x, t, None, Need())

    return work
