"""Evidence of an edit that a 2D editor drew: measurements, pictures and the work that it took."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gsedit.measures.evaluation_input import Evaluation
from gsedit.paper.session import Work
from gsedit.paper.settings import EditSettings
from gsedit.paper.skips import Decision
from gsedit.paper.view_plan import ViewPlan
from gsedit.run.events import Event
from gsedit.views.dataset import View


@dataclass(frozen=True)
class EditMetrics:
    """The evaluation of an edited scene, and how well its views matched.

    A metric has its name of gsedit.measures.metrics; `evaluation.value(NAME, ROLE)` reads any of
    them. The properties are those to read first, None where they were not measured.
    """

    evaluation: Evaluation
    pairs: tuple[tuple[str, str, float], ...] = ()
    """(view, view, matched fraction of latent cells) of every two views edited in one batch."""

    @property
    def matched(self) -> float | None:
        """Mean matched fraction of the pairs; None without any."""
        shares = [share for *_, share in self.pairs]
        return sum(shares) / len(shares) if shares else None

    @property
    def rmse_to_unedited(self) -> float | None:
        """RMSE between renders of the unedited and the edited scene: 0 is no edit at all."""
        edited = self.evaluation.value("rmse_to_unedited")
        return self.evaluation.value("rmse_to_unedited", "held_out") if edited is None else edited

    @property
    def psnr_to_targets(self) -> float | None:
        """Mean PSNR to the edited 2D pictures that the scene was fitted to, dB.

        It says how far the scene follows them, not how good they are.
        """
        return self.evaluation.value("psnr_to_targets")

    @property
    def psnr_to_held_out_edits(self) -> float | None:
        """Mean PSNR to pictures that the 2D editor makes of held-out views, dB."""
        return self.evaluation.value("psnr_to_targets", "held_out")

    @property
    def psnr_to_edits_alone(self) -> float | None:
        """Mean PSNR to pictures of the same views that were made without the targets, dB."""
        return self.evaluation.value("psnr_to_edits_alone", "held_out")

    @property
    def psnr_to_ground_truth(self) -> float | None:
        """Mean PSNR to the true edit at the held-out cameras, dB."""
        return self.evaluation.value("psnr_to_ground_truth", "held_out")

    @property
    def rmse_outside_region(self) -> float | None:
        """RMSE to the unedited scene at the edited views, over pixels outside the region."""
        return self.evaluation.value("rmse_outside_region")

    @property
    def psnr_outside_region(self) -> float | None:
        """PSNR to the unedited scene at held-out cameras, dB, over pixels outside the region."""
        return self.evaluation.value("psnr_outside_region", "held_out")

    def record(self) -> dict[str, Any]:
        """All measurements as JSON has them."""
        return {"matched": self.matched, "pairs": self.pairs, **self.evaluation.record()}

    def describe(self) -> str:
        """The numbers to read first, on one line."""
        parts = [
            f"{row.pictures} differ between near views by {row.edited:.3f}, unedited renders by "
            f"{row.unedited:.3f}"
            for row in self.evaluation.warp
            if row.range == "short"
        ]
        if self.rmse_to_unedited is not None:
            parts.insert(0, f"changed by {self.rmse_to_unedited:.3f} RMSE (0 is no edit)")
        if self.psnr_to_held_out_edits is not None:
            parts.append(f"{self.psnr_to_held_out_edits:.1f} dB to edits of held-out views")
        if self.psnr_to_edits_alone is not None:
            parts.append(f"{self.psnr_to_edits_alone:.1f} dB to edits of held-out views made alone")
        if self.psnr_outside_region is not None:
            edited = self.rmse_outside_region
            parts.append(
                f"outside the region {self.psnr_outside_region:.1f} dB to the unedited scene at "
                f"held-out views" + (f", RMSE {edited:.4f} at edited ones" if edited else "")
            )
        return "; ".join(parts)


SHEET_HELD_OUT_VIEWS = 2
"""Most held-out views in before_after.png."""


@dataclass(frozen=True, eq=False)
class HeldOutViews:
    """Pictures of some held-out cameras; the scene was fitted to none of them."""

    originals: tuple[View, ...] = ()
    """Renders of the unedited scene."""
    edited: tuple[View, ...] = ()
    """Pictures that a 2D diffusion model makes of the first ones, tied to the targets."""
    finals: tuple[View, ...] = ()
    """Renders of the edited scene."""
    alone: tuple[View, ...] = ()
    """Pictures of the first ones that the 2D editor makes without the targets, one by one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Measurements and pictures of an edit; without a 2D editor, what it draws is empty."""

    metrics: EditMetrics
    """The measurements of the edited scene."""
    timings: dict[str, float]
    """Seconds per stage, and in total."""
    settings: EditSettings
    """The settings, with the editor's defaults filled in."""
    held_out: HeldOutViews
    """Some cameras of which no edited picture was used."""
    originals: tuple[View, ...] = ()
    """Renders of the unedited scene at the edited views."""
    targets: tuple[View, ...] = ()
    """The edited 2D pictures that the scene was fitted to; none where the strategy edits none."""
    finals: tuple[View, ...] = ()
    """Renders of the edited scene at the edited views."""
    strategy: Any = None
    """The strategy: a record of its settings."""
    strategy_name: str = "routes"
    """The strategy's name, as in `--strategy NAME`; "routes": no view was edited."""
    view_plan: ViewPlan = field(default_factory=lambda: ViewPlan((), ()))
    """The views that were to be edited, by batch, and what they cover."""
    work: Work = field(default_factory=Work)
    """Optimizer steps, views asked of the editor, network evaluations."""
    decisions: tuple[Decision, ...] = ()
    """The decisions to skip work, with their reasons."""
    events: tuple[Event, ...] = ()
    """All events of the edit, in order."""
