"""The arms: the method as printed and gsedit's, each with one thing changed, and the baselines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gsedit.measures.perceptual import is_installed
from research.paper.runs import Arm

PAPER, DEFAULT, ITERATIVE = "paper", "default", "iterative"
STEPS = 20
"""Denoising steps of an edit in every arm that is raced, whatever the editor's own number:
Instruct-NeRF2NeRF's and InstructPix2Pix's. The paper has 50, with which figure 6 is repeated."""
SAME: dict[str, dict[str, Any]] = {
    PAPER: {"batches": 3, "sampler.steps": STEPS},
    DEFAULT: {"batches": 4, "sampler.steps": STEPS},
}
"""Twelve views for both: batches of 4 as printed, of 3 by default."""
T_END_OF = 50
T_END_STEPS = (0, 10, 20, 30, 40, 50)
"""The steps, of T_END_OF, in which views are averaged: the paper's figure 6."""
T_END_SHARE = 0.2
"""Share of the steps in which the method as printed averages: 10 of 50."""
PERCEPTUAL = "L1 + perceptual"
"""The loss of Instruct-NeRF2NeRF with a distance of the kind of LPIPS."""

ONE_IN: dict[str, Mapping[str, Any]] = {
    "anchors": {"anchors": 4},
    "shared noise": {"sampler.noise": "shared"},
    "x0 averaged": {"sampler.target": "x0"},
    "no consensus": {"sampler.consensus": False},
    "harmonised": {"sampler.harmonise": True},
    "planned views": {"view_plan": "covering"},
    "no visibility rules": {"visibility": False},
    "MSE": {"update.loss": "mse"},
    "random switch": {"update.switch": 0.5},
    PERCEPTUAL: {"update.loss": "l1+perceptual"},
    "colors only": {"geometry": "appearance"},
    "MSE, colors only": {"update.loss": "mse", "geometry": "appearance", "update.stepped": True},
    "MSE, colors solved": {"update.loss": "mse", "geometry": "appearance"},
}
"""Changes of the method as printed."""
ONE_OUT: dict[str, Mapping[str, Any]] = {
    "no anchors": {"anchors": 0},
    "independent noise": {"sampler.noise": "independent"},
    "x_t averaged": {"sampler.target": "xt"},
    "no consensus": {"sampler.consensus": False},
    "not harmonised": {"sampler.harmonise": False},
    "random views": {"view_plan": "random"},
    "Adam": {"update.stepped": True},
    "Adam, 30 Gram": {"update.loss": "mse+gram"},
}
"""Changes of gsedit's default."""
BASES = {
    f"{PAPER}: MSE, colors only": f"{PAPER}: MSE",
    f"{PAPER}: MSE, colors solved": f"{PAPER}: MSE, colors only",
    f"{DEFAULT}: Adam, 30 Gram": f"{DEFAULT}: Adam",
}
"""Arms that differ in one thing from another arm than their preset."""


def base_of(label: str) -> str | None:
    """Label of the arm from which an arm differs in one thing; None for others."""
    preset, changed, _ = label.partition(": ")
    return BASES.get(label, preset if changed and preset in SAME else None)


def preset_arms(preset: str) -> Iterator[Arm]:
    """A preset, and it with each change."""
    same, changes = SAME[preset], ONE_IN if preset == PAPER else ONE_OUT
    yield Arm(preset, preset, settings=same)
    for label, settings in changes.items():
        if label != PERCEPTUAL or is_installed():
            yield Arm(f"{preset}: {label}", preset, settings={**same, **settings})


def baseline_arms(steps: int) -> list[Arm]:
    """Instruct-NeRF2NeRF's update.

    The loss and everything else is as the paper's method has it.
    """
    edits = {"sampler.steps": STEPS}
    return [
        Arm(ITERATIVE, PAPER, "iterative", {"total_steps": steps}, edits),
    ]


def t_end_arms() -> list[Arm]:
    """The method as printed, with averaging in more or fewer steps."""
    same = {**SAME[PAPER], "sampler.steps": T_END_OF}
    return [Arm(t_end_label(n), PAPER, settings={**same, "averaged_steps": n}) for n in T_END_STEPS]


def t_end_label(steps: int) -> str:
    """Label of the arm with averaging in so many steps."""
    return f"{PAPER}: T_end = {steps}"
