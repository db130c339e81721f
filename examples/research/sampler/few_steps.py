"""The end of consensus and the start of sampling, for a flow model of four steps.

    python -m research.sampler.few_steps

The closed-form editor stands for a model that guidance and few steps were distilled into: the
noise levels are DreamLite-mobile's for pictures of 256 pixels, and only the branch of text and
picture is predicted, as a flow. Its posterior means are exact, so one step from a level at which
the variant is decided ends in it. Real models of few steps may do better or worse.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsedit.bench.provenance import provenance
from gsedit.bench.results import markdown_table
from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import NoiseLevel, Schedule
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import Capabilities
from gsedit.editors.closed_form import ClosedForm
from gsedit.editors.looks.recipe import agreed_variant, parse
from research.command import print_result
from research.sampler.measurements import rms
from research.sampler.overlapping import PROMPT, OverlappingViews, picture_views

STEPS, SEEDS = 4, 12
CELLS = 32 * 32 // 4  # tokens of 2 x 2 cells of 8 pixels, of a picture of 256 pixels
FLOW = FlowScheduler(dynamic=True)
STRENGTHS = (0.98, 0.9, 0.8, 0.6, 0.4)


@dataclass(frozen=True, eq=False)
class FlowEditor(ClosedForm):
    """The closed-form editor on straight paths."""

    schedule: Schedule = field(default_factory=Schedule.rectified_flow)
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Its levels are those of FLOW, of however large a picture."""
        return replace(super().capabilities, levels=lambda settings, cells: levels(settings))

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """eps - x0 of x = a x0 + b eps; the closed form is of a and b whose squares sum to 1."""
        level = self.schedule.level(t)
        unit = x / (level.a**2 + level.b**2) ** 0.5
        noises = super().branches(unit, t, condition, need)
        return Branches(*(e if e is None else e - (x - level.b * e) / level.a for e in noises))


def levels(settings: SamplerSettings) -> list[NoiseLevel]:
    """DreamLite-mobile's levels at 256 pixels."""
    return FLOW.levels(settings.step_count, settings.strength, mu=FLOW.mu(CELLS))


@dataclass(frozen=True)
class Outcome:
    """Means over all seeds."""

    agreeing: float
    """Share of views that show the variant that most views show."""
    disagreement: float
    """RMS difference of corresponding pixels from their mean."""
    error: float
    """RMS difference from the variant that most views show, without perturbations."""
    sharpness: float
    """RMS step from pixel to pixel over that of the variant without perturbations."""
    change: float
    """RMS difference from the unedited views."""


def measure(views: OverlappingViews, settings: SamplerSettings) -> Outcome:
    """Edit with every seed."""
    recipe, sums = parse(PROMPT), [0.0] * 5
    for seed in range(SEEDS):
        edited = views.edit(settings, seed)
        variant, votes = agreed_variant(recipe, edited, views.originals)
        true = recipe.variant(views.originals, variant)
        found = (
            sum(int(vote) == variant for vote in votes) / len(edited),
            views.disagreement(edited),
            rms(edited - true),
            rms(edited.diff(dim=2)) / rms(true.diff(dim=2)),
            rms(edited - views.originals),
        )
        sums = [total + each / SEEDS for total, each in zip(sums, found)]
    return Outcome(*sums)


def row(name: str, outcome: Outcome) -> list[str]:
    """Cells of a table."""
    numbers = (outcome.disagreement, outcome.error, outcome.sharpness, outcome.change)
    return [name, f"{100 * outcome.agreeing:.0f} %", *(f"{number:.3f}" for number in numbers)]


def main() -> None:
    """Print two tables: the end of consensus, and the strength."""
    views = picture_views(denoiser=FlowEditor())
    base = SamplerSettings(steps=STEPS, solver="euler", guidance_text=1.0, guidance_image=1.0)
    sigmas = [level.sigma for level in levels(base)[:-1]]
    rows = []
    for noise in ("independent", "shared"):
        for acting in range(STEPS + 1):
            end = sigmas[acting] if acting < STEPS else 0.0
            settings = replace(base, noise=noise, t_end=end, consensus=acting > 0)
            name = f"{noise} noise, {acting} of {STEPS} steps"
            rows.append(row(f"{name} (t_end {end:.2g})", measure(views, settings)))
    for strength in STRENGTHS:
        settings = replace(base, strength=strength, t_end=1.2)
        rows.append(row(f"strength {strength:g}, t_end 1.2", measure(views, settings)))
    of = provenance()
    print_result(f"{of.date}, commit {of.commit}, {of.machine}. Sigmas: {_list(sigmas)}.")
    head = ("", "agreeing views", "disagreement", "error", "sharpness", "change")
    print_result(markdown_table(head, rows))


def _list(numbers: list[float]) -> str:
    return ", ".join(f"{number:.3g}" for number in numbers)


if __name__ == "__main__":
    main()
