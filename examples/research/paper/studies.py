"""The experiments: which arms, on which scenes, with which editors and seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from gsedit.editing.strategies import strategy_names
from gsedit.measures.perceptual import is_installed
from research.paper.cases import CAPTURE_PROMPT, PROMPTS, TUNING
from research.paper.runs import Arm, Case, Run

SINGLE_PASS, ITERATIVE, COMBINED, BULK, SDS = STRATEGIES = (
    "single-pass", "iterative", "combined", "bulk", "sds",
)  # fmt: skip
UPDATE, BETWEEN = 100, 10
"""Fitting steps after a batch of the single pass, and after a view of iterative: the defaults, the
latter Instruct-NeRF2NeRF's. The study "tuning" shows half and twice as many of both."""
PATCH = 64
"""Pixels a side of the one crop that a fitting step renders of a synthetic scene."""
FEWER = 5
SHORTER = f"{ITERATIVE}, a fifth of the steps"
"""The baseline with less work: a speed-up over the paper's number of steps alone would flatter."""
LPIPS = "L1 + perceptual (Instruct-NeRF2NeRF)"
"""A distance of the kind of LPIPS, which needs the extra `perceptual`."""
BULK_ROUNDS = 3
"""Rounds of Instruct-GS2GS's bulk update."""
CLOSED_FORM, SMALL = EDITORS = ("closed-form", "small")
FIGURE_STEPS, T_END_STEPS = 50, (0, 10, 20, 30, 40, 50)
"""Denoising steps of the paper's figure 6, and for how many of them views are averaged (0: its
figure 5b)."""
PAPER = {"sampler.target": "xt", "sampler.noise": "independent", "sampler.harmonise": False}
"""Eq. (averageall) as printed."""
SHARED = {"sampler.harmonise": False}
"""Ours: x0 averaged, the noise shared; the pictures as they were sampled."""


@dataclass(frozen=True)
class Size:
    """How much is run; every number is in the report."""

    name: str
    scenes: int
    """Synthetic scenes that strategies are compared on; sweeps use `sweep_scenes` of them."""
    sweep_scenes: int
    small_scenes: int
    """Number of these scenes for the editor `small`."""
    seeds: int
    small_seeds: int
    tuning_seeds: int
    capture_seeds: int
    pixels: int
    gaussians: int
    views: int
    iterative_steps: int
    """Steps of iterative from scratch, bulk and sds: the paper's 3000."""
    further_steps: int
    """Steps of iterative after the single pass: the paper's 800."""
    sweep_steps: int
    """Fitting steps of a round in the sweeps of the sampler and of the loss, which have two."""
    capture_pixels: int
    capture_iterative_steps: int


QUICK = Size(
    "quick", scenes=3, sweep_scenes=2, small_scenes=1, seeds=2, small_seeds=2, tuning_seeds=1,
    capture_seeds=1, pixels=96, gaussians=2000, views=24, iterative_steps=1500, further_steps=400,
    sweep_steps=75, capture_pixels=96, capture_iterative_steps=600,
)  # fmt: skip
FULL = Size(
    "full", scenes=5, sweep_scenes=3, small_scenes=3, seeds=5, small_seeds=5, tuning_seeds=2,
    capture_seeds=5, pixels=96, gaussians=3000, views=32, iterative_steps=3000, further_steps=800,
    sweep_steps=100, capture_pixels=192, capture_iterative_steps=3000,
)  # fmt: skip


@dataclass(frozen=True)
class Study:
    """Arms that are compared with each other on the same cases and seeds."""

    name: str
    title: str
    place: str
    """Figure or section of the paper."""
    runs: tuple[Run, ...] = field(default=())


def studies(size: Size, capture: Case | None = None) -> tuple[Study, ...]:
    """All of them, those that decide first. Strategies that are not there are left out."""
    cases = [_synthetic(name, prompt, size) for name, prompt in PROMPTS.items()][: size.scenes]
    swept = cases[: size.sweep_scenes]
    main = strategy_arms(size.iterative_steps, size.further_steps)
    seeds, small = range(size.seeds), range(size.small_seeds)
    compared = [
        *_runs(main, cases, CLOSED_FORM, seeds),
        *_runs(main, cases[: size.small_scenes], SMALL, small),
    ]
    if capture is not None:
        arms = strategy_arms(size.capture_iterative_steps, size.further_steps)
        chosen = [arm for arm in arms if size is FULL or arm.strategy in (SINGLE_PASS, ITERATIVE)]
        for editor in EDITORS if size is FULL else EDITORS[:1]:
            compared += _runs(chosen, [capture], editor, range(size.capture_seeds))
    found = [
        Study("strategies", "Strategies", "Figures 2, 7, 8, 9; sections 4.3, 5.1", tuple(compared)),
        Study("t-end", "Steps with averaging", "Figures 5, 6; section 4.2",
              _runs(t_end_arms(size.sweep_steps), swept[:1] if size is QUICK else swept,
                    CLOSED_FORM, seeds)),
        Study("consensus", "What is averaged, and the noise", "Section 4.1, eq. (averageall)",
              _runs(consensus_arms(size.sweep_steps), swept, CLOSED_FORM, seeds)),
        Study("loss", "The loss of the update", "Figure 11; eq. (loss), section 5.2",
              _runs(loss_arms(size.sweep_steps), swept, CLOSED_FORM, seeds)),
        Study("views", "Views of a batch", "Section 4.3: B, the paper has 4",
              _runs(view_arms(), swept, CLOSED_FORM, seeds)),
        Study("visibility", "Which matches are believed", "Section 4.1: noise in the pairs",
              _runs(visibility_arms(size.sweep_steps), swept, CLOSED_FORM, seeds)),
    ]  # fmt: skip
    if size.tuning_seeds:
        tuned = [_synthetic(*TUNING, size)]
        arms = tuning_arms(size.iterative_steps // FEWER)
        runs = _runs(arms, tuned, CLOSED_FORM, range(100, 100 + size.tuning_seeds))
        found.append(Study("tuning", "Tuning", "Of both methods, on a scene of its own", runs))
    return tuple(study for study in found if study.runs)


def capture_case(scene: str, data: str, size: Size) -> Case:
    """A capture, as the bear."""
    pixels = size.capture_pixels
    return Case("capture", CAPTURE_PROMPT, pixels, 2, pixels // 2, scene=scene, data=data)


def _synthetic(name: str, prompt: str, size: Size) -> Case:
    return Case(name, prompt, size.pixels, 1, PATCH, size.gaussians, size.views)


def strategy_arms(steps: int, further: int) -> list[Arm]:
    """The strategies, at their defaults but for the number of steps."""
    fewer, round_steps = steps // FEWER, steps // (2 * BULK_ROUNDS)
    return _known(
        Arm(SINGLE_PASS, SINGLE_PASS, {"update_steps": UPDATE}),
        Arm(ITERATIVE, ITERATIVE, {"total_steps": steps, "steps_between": BETWEEN}),
        Arm(SHORTER, ITERATIVE, {"total_steps": fewer, "steps_between": BETWEEN}),
        Arm(COMBINED, COMBINED,
            {"update_steps": UPDATE, "further_steps": further, "steps_between": BETWEEN}),
        Arm(BULK, BULK, {"edit_rounds": BULK_ROUNDS, "steps_between": round_steps}),
        Arm(SDS, SDS, {"total_steps": steps // 3}),
    )  # fmt: skip


def t_end_arms(steps: int) -> list[Arm]:
    """Averaging in the first 0 to 50 of 50 steps, as printed and as ours."""
    arms = []
    for label, base in (("x_t-1, independent noise", PAPER), ("x0, shared noise", SHARED)):
        for averaged in T_END_STEPS:
            end = {"sampler.consensus": averaged > 0, "sampler.t_end": _end_after(averaged)}
            arms.append(_sampled(f"{label}: {averaged}", steps, {**base, **end}))
    return arms


def consensus_arms(steps: int) -> list[Arm]:
    """Targets and noise, T_end at the editor's own."""
    alone = {"sampler.consensus": False, "sampler.noise": "independent"}
    return [
        _sampled("none, independent noise", steps, alone),
        _sampled("none, shared noise", steps, {"sampler.consensus": False}),
        _sampled("x_t-1, independent noise (paper)", steps, PAPER),
        _sampled("x_t-1, shared noise", steps, {**PAPER, "sampler.noise": "shared"}),
        _sampled("x0, independent noise", steps, {**SHARED, "sampler.noise": "independent"}),
        _sampled("x0, shared noise", steps, SHARED),
        _sampled("x0, shared noise, harmonised (default)", steps, {}),
    ]


def loss_arms(steps: int) -> list[Arm]:
    """MSE alone, Gram weights, the random switch, Instruct-NeRF2NeRF's loss where its distance is
    installed; on pictures that contradict each other."""
    contradicting = {"sampler.consensus": False}  # noise shared, colors and places of each view
    arms = []
    for label, settings in {
        "MSE": {},
        "MSE + 0.1 Gram (paper's weight)": {"update.loss": "mse+0.1*gram"},
        "MSE + 30 Gram": {"update.loss": "mse+gram"},
        "MSE + 300 Gram": {"update.loss": "mse+300*gram"},
        "switch, 30 Gram": {"update.switch": 0.5},
        LPIPS: {"update.loss": "l1+perceptual"},
    }.items():
        if label == LPIPS and not is_installed():
            continue
        arms.append(_rounds(label, steps, {**contradicting, **settings}))
    return arms


def view_arms() -> list[Arm]:
    """Twelve views and as many fitting steps, in batches of 1 to 6."""
    return [
        Arm(f"{views} a batch", SINGLE_PASS, {"update_steps": UPDATE * views // 3},
            {"views_per_batch": views, "batches": 12 // views})
        for views in (1, 2, 3, 4, 6)
    ]  # fmt: skip


def visibility_arms(steps: int) -> list[Arm]:
    """The rules that a match must pass, and without them."""
    return [
        _sampled("rules on (default)", steps, SHARED),
        _sampled("rules off", steps, {**SHARED, "visibility": False}),
        _sampled("as printed, rules on", steps, PAPER),
        _sampled("as printed, rules off", steps, {**PAPER, "visibility": False}),
    ]


def tuning_arms(steps: int) -> list[Arm]:
    """List the paper's two methods with three numbers of fitting steps between edits each."""
    return _known(
        *(
            Arm(f"{SINGLE_PASS}: {between} steps a batch", SINGLE_PASS, {"update_steps": between})
            for between in (50, 100, 200)
        ),
        *(
            Arm(f"{ITERATIVE}: {between} steps a view", ITERATIVE,
                {"total_steps": steps, "steps_between": between})
            for between in (5, 10, 20)
        ),
    )  # fmt: skip


def _known(*arms: Arm) -> list[Arm]:
    """Those whose strategies are there."""
    names = strategy_names()
    return [arm for arm in arms if arm.strategy in names]


def missing_strategies() -> tuple[str, ...]:
    """Strategies of the paper's comparison that are not there."""
    return tuple(name for name in STRATEGIES if name not in strategy_names())


def _sampled(label: str, steps: int, settings: dict[str, Any]) -> Arm:
    """Two rounds of four views, sampled in as many steps as the paper's."""
    return _rounds(label, steps, {"sampler.steps": FIGURE_STEPS, **settings})


def _rounds(label: str, steps: int, settings: dict[str, Any]) -> Arm:
    """Two rounds of the paper's four views."""
    return Arm(
        label, SINGLE_PASS, {"update_steps": steps},
        {"views_per_batch": 4, "batches": 2, **settings},
    )  # fmt: skip


def _end_after(steps: int) -> float:
    """The t_end with which views are averaged in the first `steps` of the 50."""
    from gsedit.diffusion.sampler import levels_of
    from gsedit.diffusion.settings import SamplerSettings
    from gsedit.editors.closed_form import fine_schedule

    levels = levels_of(fine_schedule(), SamplerSettings(steps=FIGURE_STEPS))
    return levels[steps].sigma if steps < FIGURE_STEPS else 0.0


def _runs(
    arms: Sequence[Arm], cases: Iterable[Case], editor: str, seeds: Iterable[int]
) -> tuple[Run, ...]:
    seeds = tuple(seeds)
    return tuple(Run(arm, case, editor, s) for s in seeds for case in cases for arm in arms)
