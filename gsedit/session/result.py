"""The result of an edit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gsedit.regions.region import Region
from gsedit.reports.contact_sheet import contact_sheet
from gsedit.reports.events import Event
from gsedit.reports.notebook import as_html, attempt, decibels, png_bytes
from gsedit.savings.decision import Decision
from gsedit.session.held_out import HeldOutViews
from gsedit.session.quality import EditQuality
from gsedit.session.session import Work
from gsedit.session.settings import EditSettings
from gsedit.views.dataset import View
from gsedit.views.plan import ViewPlan
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class EditResult:
    """An edited scene and its evidence: the same cameras three times."""

    prompt: str
    scene: Gaussians
    originals: tuple[View, ...]
    """Renders of the unedited scene."""
    targets: tuple[View, ...]
    """The edited 2D pictures that the scene was fitted to; none where the strategy edits none."""
    finals: tuple[View, ...]
    """Renders of the edited scene."""
    settings: EditSettings
    """With the editor's defaults filled in."""
    strategy: Any
    """The strategy: a record of its settings."""
    strategy_name: str
    """As in `--strategy NAME`."""
    plan: ViewPlan
    """Which views were to be edited, and what they cover."""
    region: Region
    """Where the edit belonged."""
    quality: EditQuality
    """What was measured."""
    work: Work
    """Optimiser steps, views asked of the editor, network evaluations."""
    timings: dict[str, float]
    """Seconds per stage, and in total."""
    held_out: HeldOutViews = field(default_factory=HeldOutViews)
    """Some cameras of which no edited picture was used."""
    decisions: tuple[Decision, ...] = ()
    """What was left out, and what was needed; none without a plan."""
    events: tuple[Event, ...] = ()
    """What happened, in order."""

    def __repr__(self) -> str:
        return f"EditResult({self.prompt!r}, {self.scene!r})"

    def _repr_png_(self) -> bytes | None:
        """What a notebook shows: some views before the edit, as edited in 2D, and after it."""
        return attempt(self._picture)

    def _repr_html_(self) -> str | None:
        """The same with what was measured."""
        return attempt(lambda: as_html(self.prompt, self._rows(), self._picture()))

    def _picture(self) -> bytes:
        rows = {"original": self.originals, "2D targets": self.targets, "edited": self.finals}
        shown = [(label, views) for label, views in rows.items() if views]
        return png_bytes(contact_sheet(shown, columns=4))

    def _rows(self) -> dict[str, str]:
        quality = self.quality
        return {
            "Gaussians": f"{len(self.scene):,}",
            "region": str(self.region),
            "strategy": self.strategy_name,
            "seconds": f"{self.timings['total']:.0f}" if "total" in self.timings else "",
            "PSNR to the 2D targets": decibels(quality.residual_to_targets_db),
            "PSNR to edits of held-out views": decibels(quality.psnr_to_held_out_edits),
            "PSNR of what was to be kept": decibels(quality.kept),
        }
