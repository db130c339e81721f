"""The plan: which arms run on which scenes, with which editors and seeds, and what they cost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from research.paper.arms import (
    DEFAULT,
    ITERATIVE,
    PAPER,
    baseline_arms,
    preset_arms,
    t_end_arms,
)
from research.paper.cases import PROMPTS, synthetic
from research.paper.runs import Arm, Case, Run

CLOSED_FORM, VARIED = "closed-form", "varied"
BRANCHES = {CLOSED_FORM: 3, VARIED: 1}
"""Evaluations of an editor a denoising step."""


@dataclass(frozen=True)
class Size:
    """How much is run; every number is in the report."""

    name: str
    scenes: int
    """Number of synthetic scenes."""
    seeds: int
    pixels: int
    gaussians: int
    views: int
    iterative_steps: int
    """Steps of iterative: the paper's 3000."""
    update_steps: int | None = None
    """Steps of Adam after a batch; None: as each method has it."""


QUICK = Size("quick", 2, 2, 64, 1000, 16, 60, 20)
FULL = Size("full", 5, 5, 256, 50_000, 32, 3000)


@dataclass(frozen=True)
class Study:
    """Runs that are compared with each other."""

    name: str
    runs: tuple[Run, ...]


def studies(size: Size, captures: Sequence[Case] = ()) -> tuple[Study, ...]:
    """All of them. Scenes take turns with the seeds: scene i has the seeds i, i + 1, ..."""
    made = [synthetic(n, size.pixels, size.gaussians, size.views) for n in PROMPTS][: size.scenes]
    every = [*made, *captures]

    def runs(arms: Iterable[Arm], *shares: tuple[str, Sequence[Case], int]) -> tuple[Run, ...]:
        arms = tuple(_shortened(arm, size) for arm in arms)
        return tuple(
            Run(arm, case, editor, (number + k) % size.seeds)
            for editor, cases, seeds in shares
            for number, case in enumerate(cases)
            for k in range(min(seeds, size.seeds))
            for arm in arms
        )

    closed, varied, once = (CLOSED_FORM, made[:3], 1), (VARIED, every, 2), (VARIED, every, 1)
    baselines = baseline_arms(size.iterative_steps)
    printed = list(preset_arms(PAPER))
    return (
        Study("paper", runs(printed, closed, varied)),
        Study("default", runs(preset_arms(DEFAULT), (CLOSED_FORM, made, 1), varied)),
        Study("strategies", runs(baselines, closed, once)),
        Study("t-end", runs(t_end_arms(), once)),
    )


def _shortened(arm: Arm, size: Size) -> Arm:
    """The arm with the size's steps after a batch, where it takes any."""
    if size.update_steps is None or arm.strategy.startswith(ITERATIVE):
        return arm
    return replace(arm, options={"update_steps": size.update_steps, **arm.options})


def distinct(found: Iterable[Study]) -> dict[str, Run]:
    """By key, the runs of all studies, those of a scene and editor together."""
    runs = {run.key: run for study in found for run in study.runs}
    return dict(sorted(runs.items(), key=lambda item: (item[1].case.name, item[1].editor)))
