"""Variants of consensus: how far views agree, and what contrast and edit strength remain.

Agreement alone is no merit: identical grey views agree. The deviation is signed: a consensus that
drives views past each other has a disagreement that first falls and then rises again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product

from gsedit.paper.diffusion.sampler import levels_of
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.run.stopwatch import Stopwatch
from research.sampler.measurements import SamplerMeasurement, rms
from research.sampler.overlapping import OverlappingViews, texture_views

VARIANTS: dict[str, dict[str, object]] = {
    "none, independent noise": {"consensus": False, "noise": "independent"},
    "none, shared noise": {"consensus": False},
    "xt, independent (paper)": {"target": "xt", "noise": "independent"},
    "xt, shared": {"target": "xt"},
    "x0, independent": {"noise": "independent"},
    "x0, shared (default)": {},
    "x0, shared, to the end": {"t_end": 0.0},
    "x0, shared, half strength": {"consensus_weight": 0.5},
    "eps, shared": {"target": "eps"},
    "x0, shared, heun": {"solver": "heun"},
    "x0, shared, dpm++2m": {"solver": "dpm++2m"},
    "x0, shared, ancestral": {"solver": "ancestral"},
}
SWEPT = ("xt, independent (paper)", "x0, shared (default)", "xt, shared")
SWEEP_STEPS, SWEEP = 50, (0, 10, 20, 30, 40, 50)
"""Steps, and steps with consensus: the paper's figure has 10 to 50 of 50."""


def consensus_study(
    seeds: int, groups: Iterable[OverlappingViews] | None = None, sweep: Iterable[int] = SWEEP
) -> Iterator[SamplerMeasurement]:
    """Every variant of consensus at 20 steps, then the sweep of T_end; means over seeds."""
    sweep = tuple(sweep)
    for views in groups or (texture_views(),):
        alone = _measurement(views, {"consensus": False, "noise": "independent"}, seeds, None)
        for variant, options in VARIANTS.items():
            yield _measurement(views, {"steps": 20, **options}, seeds, alone, variant)
        for variant, with_consensus in product(SWEPT, sweep):
            options = {
                **VARIANTS[variant], "steps": SWEEP_STEPS, "strength": 1.0,
                "consensus": with_consensus > 0, "t_end": _end_after(with_consensus, views),
            }  # fmt: skip
            row = _measurement(views, options, seeds, alone, variant)
            yield replace(row, t_end=float(with_consensus), problem=f"{views.name}, T_end")


def _end_after(steps: int, views: OverlappingViews) -> float:
    """The t_end with which consensus acts in the first `steps` of the sweep's."""
    levels = levels_of(views.schedule, SamplerSettings(steps=SWEEP_STEPS, strength=1.0))
    return levels[steps].sigma if steps < SWEEP_STEPS else 0.0


def _measurement(
    views: OverlappingViews,
    options: dict[str, object],
    seeds: int,
    alone: SamplerMeasurement | None,
    variant: str = "",
) -> SamplerMeasurement:
    """Means over seeds; the contrast is relative to that of the measurement `alone`, if given."""
    settings = SamplerSettings(**options)  # pyright: ignore[reportArgumentType]
    stopwatch = Stopwatch()
    results = [views.edit(settings, seed) for seed in range(seeds)]
    seconds = stopwatch.seconds / seeds
    free = [views.edit(replace(settings, consensus=False), seed) for seed in range(seeds)]
    contrast = sum(float(x.flatten(1).std(1).mean()) for x in results) / seeds
    return SamplerMeasurement(
        "consensus",
        views.name,
        variant,
        settings.step_count,
        settings.step_count * (2 if settings.method == "heun" else 1),
        seconds,
        disagreement=sum(views.disagreement(x) for x in results) / seeds,
        deviation=sum(map(views.deviation, results, free)) / seeds,
        contrast=contrast / alone.contrast if alone and alone.contrast else contrast,
        strength=sum(rms(x) for x in results) / seeds,
    )
