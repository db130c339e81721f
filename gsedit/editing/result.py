"""The result of an edit: the edited scene, where its Gaussians come from, and its evidence."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Int
from torch import Tensor

from gsedit.paper.evidence import Evidence
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.pictures.notebook import as_html, attempt, decibels, png_bytes
from gsedit.select.region import Region
from gsedit.words.instruction import Instruction
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False, kw_only=True)
class EditResult(Evidence):
    """An edited scene and its evidence: the same cameras three times."""

    prompt: str
    scene: Gaussians
    region: Region
    """The Gaussians that could change, of `scene`."""
    region_before: Region | None = None
    """The Gaussians of the unedited scene that changed or are gone; None where its rows stay."""
    origin: Int[Tensor, " m"] | None = None
    """The row in the unedited scene of each Gaussian, NEW (gsedit.scene.outcome) for a new one;
    None where its rows stay."""
    understood: Instruction | None = None
    """The changes that were read in the sentence; None where a 2D editor got it as it is."""
    notes: tuple[str, ...] = ()
    """Remarks for a person on how changes were done on the Gaussians."""

    def __repr__(self) -> str:
        return f"EditResult({self.prompt!r}, {self.scene!r})"

    def _repr_png_(self) -> bytes | None:
        """A picture for notebooks: some views before the edit, as edited in 2D, and after it."""
        return attempt(self._picture)

    def _repr_html_(self) -> str | None:
        """A page for notebooks: the pictures and the measurements."""
        return attempt(lambda: as_html(self.prompt, self._rows(), self._picture()))

    def _picture(self) -> bytes:
        originals, finals = self.originals, self.finals
        if not originals:
            originals, finals = self.held_out.originals, self.held_out.finals
        rows = {"original": originals, "2D targets": self.targets, "edited": finals}
        shown = [(label, views) for label, views in rows.items() if views]
        return png_bytes(contact_sheet(shown, columns=4))

    def _rows(self) -> dict[str, str]:
        metrics = self.metrics
        return {
            "Gaussians": f"{len(self.scene):,}",
            "region": str(self.region),
            "strategy": self.strategy_name,
            "seconds": f"{self.timings['total']:.0f}" if "total" in self.timings else "",
            "PSNR to the 2D targets": decibels(metrics.psnr_to_targets),
            "PSNR to edits of held-out views": decibels(metrics.psnr_to_held_out_edits),
            "PSNR to held-out edits made alone": decibels(metrics.psnr_to_edits_alone),
            "PSNR outside the region": decibels(metrics.psnr_outside_region),
        }
