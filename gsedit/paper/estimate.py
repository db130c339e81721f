"""The cost of an edit by a diffusion model, measured on one evaluation before it begins."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from gsedit.paper.diffusion.precision import has_bfloat16
from gsedit.paper.edit_views import batch_of
from gsedit.paper.protocol import Cost
from gsedit.paper.request import asks_editor, fits_pictures
from gsedit.paper.session import Session
from gsedit.run.stopwatch import duration

BRANCHES = 2.5
"""Branches a step from which sharing guidance halves the time: it leaves 1.4."""
MANY_STEPS = 16
"""Steps from which half as many are worth naming: fewer are of models made for few."""


@dataclass(frozen=True)
class Estimate:
    """Time and memory of an edit whose views are each edited once."""

    views: int
    """Views that are edited, at most."""
    held_out: int
    """Pictures that the editor is asked for at the end, to compare the scene with: of each view
    two."""
    cost: Cost
    cheaper: str
    """A setting with which it takes half as long or less; empty where none is known."""

    @property
    def seconds(self) -> float:
        """Wall time of the 2D editor; the scene is fitted in seconds."""
        return self.cost.seconds(self.views + self.held_out)

    def describe(self, now: datetime | None = None) -> str:
        """The estimate as one sentence; `now` is when the edit begins."""
        cost, number = self.cost, self.views + self.held_out
        end = (now or datetime.now()) + timedelta(seconds=self.seconds)
        compared = f" ({self.held_out} of them to compare with)" if self.held_out else ""
        branches = cost.evaluations / max(cost.steps, 1)
        parts = [
            f"{number} views{compared}, {cost.steps} steps of {branches:.3g} branches, "
            f"{cost.evaluation_s:.2g} s each in {cost.precision}: about {duration(self.seconds)}, "
            f"until {end:%H:%M}"
        ]
        if cost.peak_bytes:
            parts.append(f"{cost.peak_bytes / 1e9:.1f} GB of memory")
        if self.cheaper:
            parts.append(f"{self.cheaper} takes half as long or less")
        return "; ".join(parts)


def estimate_edit(session: Session) -> Estimate | None:
    """The estimate of an edit that has not begun, by evaluating the network for the first batch.

    None where the editor does not measure itself, or its views are not edited once each (score
    distillation). The session is left as it was.
    """
    request = session.request
    measure = request.editor.capabilities.measure
    is_plain = asks_editor(request.strategy) and fits_pictures(request.strategy)
    if measure is None or request.ranks.size > 1 or not is_plain:
        return None
    plan = session.plan
    cost = measure(batch_of(session, plan.batches[0]), request.settings.sampler)
    held_out = 2 * min(request.settings.held_out_edits, len(request.evaluation_views))
    return Estimate(len(plan.views), held_out, cost, cheaper(cost))


def cheaper(cost: Cost) -> str:
    """An option that halves the time, as on the command line; empty where none is known.

    The one that changes the edit least comes first (docs/measurements/editors.md).
    """
    if cost.evaluations >= BRANCHES * cost.steps:
        return "--preset quick"
    if cost.precision == "float32" and has_bfloat16():
        return "--set precision=bfloat16 with --runtime openvino"
    if cost.steps >= MANY_STEPS:
        return f"--steps {cost.steps // 2}"
    return ""
