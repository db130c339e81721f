"""The plan: which arms run on which scenes, with which editors and seeds, and what they cost."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from gsedit.bench.results import markdown_table
from research.paper.arms import (
    COMBINED,
    DEFAULT,
    ITERATIVE,
    PAPER,
    baseline_arms,
    factorial_arms,
    preset_arms,
    t_end_arms,
)
from research.paper.cases import PROMPTS, synthetic
from research.paper.runs import Arm, Case, Record, Run

CLOSED_FORM, VARIED, SMALL = EDITORS = ("closed-form", "varied", "small")
SEEDS, REPEATS = 5, 10
"""Seeds of a study, and repetitions where the paper has ten (its figure 9)."""


@dataclass(frozen=True)
class Size:
    """How much is run; every number is in the report."""

    name: str
    scenes: int
    """Number of synthetic scenes."""
    seeds: int
    repeats: int
    pixels: int
    gaussians: int
    views: int
    iterative_steps: int
    """Steps of iterative: the paper's 3000."""
    further_steps: int
    """Steps of iterative after the single pass: the paper's 800."""
    update_steps: int | None = None
    """Steps of Adam after a batch; None: as each method has it."""


QUICK = Size("quick", 2, 2, 2, 64, 1000, 16, 60, 20, 20)
FULL = Size("full", 5, SEEDS, REPEATS, 256, 50_000, 32, 3000, 800)


@dataclass(frozen=True)
class Study:
    """Runs that are compared with each other."""

    name: str
    runs: tuple[Run, ...]


def studies(size: Size, captures: Sequence[Case] = ()) -> tuple[Study, ...]:
    """All of them. Scenes take turns with the seeds: scene i has the seeds i, i + 1, ...

    The editor `small` works on the captures; without any, on the first scene.
    """
    made = [synthetic(n, size.pixels, size.gaussians, size.views) for n in PROMPTS][: size.scenes]
    every, real = [*made, *captures], list(captures) or made[:1]

    def runs(arms: Iterable[Arm], *shares: tuple[str, Sequence[Case], int]) -> tuple[Run, ...]:
        arms = tuple(_shortened(arm, size) for arm in arms)
        return tuple(
            Run(arm, case, editor, (number + k) % size.seeds)
            for editor, cases, seeds in shares
            for number, case in enumerate(cases)
            for k in range(min(seeds, size.seeds))
            for arm in arms
        )

    closed, varied, small = (CLOSED_FORM, made[:3], 1), (VARIED, every, 2), (SMALL, real, 3)
    baselines = baseline_arms(size.iterative_steps, size.further_steps)
    printed = list(preset_arms(PAPER))
    again = tuple(
        replace(run, seed=seed)
        for seed in range(size.repeats)
        for run in runs((printed[0], baselines[0]), (VARIED, made[:1], 1))
    )
    return (
        Study("paper", runs(printed, closed, varied, small)),
        Study(
            "default", runs(preset_arms(DEFAULT), (CLOSED_FORM, made, 1), varied, (SMALL, real, 5))
        ),
        Study("strategies", runs(baselines, closed, (VARIED, every, 1), small)),
        Study("t-end", runs(t_end_arms(), (VARIED, every, 1), small)),
        Study("repeats", again),  # the paper's figure 9
        Study("factorial", runs(factorial_arms(), (SMALL, real, 5))),
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


EVALUATION_S, VIEW_S = {CLOSED_FORM: 0.0072, VARIED: 0.0035, SMALL: 0.015}, 0.1
"""Processor seconds of an evaluation for a view of 256 pixels, and of the rest of editing it; one
thread of a Xeon."""
STEP_S, SOLVE_S, FIXED_S = 0.014, 1.5, 5.0
"""Processor seconds of a fitting step on two crops of 64 pixels, of a solve, and of everything
else in a run: survey, matching, measurements."""
BRANCHES = {CLOSED_FORM: 3, VARIED: 1, SMALL: 2}
"""Evaluations of an editor a denoising step."""


def estimated_seconds(run: Run) -> float:
    """Processor seconds of a run, from what its parts took."""
    printed, arm = run.arm.preset == PAPER, run.arm
    denoising = 50 if printed else 10 if run.editor == SMALL else 20
    views, each = 12, arm.options.get("update_steps", 200 if printed else 100)
    stepped = arm.settings.get("update.stepped") or arm.label.endswith("Gram")
    solves = not stepped and (not printed or "solved" in arm.label)
    steps = 0 if solves else each * (3 if printed else 4)
    if arm.strategy.startswith(ITERATIVE):
        steps = arm.options["total_steps"]
        denoising, views = 20, steps / 10
    evaluations = views * denoising * BRANCHES[run.editor]
    if arm.strategy == COMBINED:
        further = arm.options["further_steps"]
        evaluations, steps = evaluations + further / 10 * 50 * BRANCHES[run.editor], steps + further
    scale = (run.case.size / 256) ** 2
    sampled = (evaluations * EVALUATION_S[run.editor] + views * VIEW_S) * scale
    steps *= 2 if run.case.scene else 1  # captures have more Gaussians
    return sampled + STEP_S * steps + SOLVE_S * solves + FIXED_S * scale


def estimate(found: Sequence[Study], records: Mapping[str, Record]) -> str:
    """A table of the plan: runs, those that are done, processor hours of a study and of what is
    left. A run that is done tells what the same arm takes with other seeds."""
    known: dict[str, list[float]] = {}
    for key, run in distinct(found).items():
        if key in records:
            known.setdefault(replace(run, seed=0).key, []).append(records[key].cpu)
    planned: dict[str, list[tuple[float, bool]]] = {}
    for study in found:
        earlier = {run.key for each in found[: found.index(study)] for run in each.runs}
        for run in (run for run in study.runs if run.key not in earlier):
            like = known.get(replace(run, seed=0).key)
            seconds = statistics.fmean(like) if like else estimated_seconds(run)
            planned.setdefault(study.name, []).append((seconds, run.key in records))
    planned["all"] = [each for runs in planned.values() for each in runs]
    rows = []
    for name, runs in planned.items():
        hours, left = sum(s for s, _ in runs) / 3600, sum(s for s, d in runs if not d) / 3600
        done = sum(is_done for _, is_done in runs)
        rows.append((name, str(len(runs)), str(done), f"{hours:.2f}", f"{left:.2f}"))
    return markdown_table(("study", "runs", "done", "processor hours", "left"), rows)
