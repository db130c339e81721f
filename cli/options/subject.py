"""The subject of an instruction as a selection."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.toolkit.selection.base import Selection
from rasterizer.numerics import AUTO

from ..core.console import print_message

if TYPE_CHECKING:
    import numpy as np

    from gsedit.scene.table import SplatTable


@dataclass(frozen=True)
class Subject(Selection):
    """The subject of an instruction, as `gsedit edit --region auto` finds it."""

    instruction: str
    scene: Path | None
    data: Path | None

    @property
    def whole(self) -> bool:
        """Whether all rows are needed at once: they are rendered."""
        return True

    @property
    def view_dependent(self) -> bool:
        """Whether all bands of SH are needed: they are rendered."""
        return True

    def mask(self, table: SplatTable) -> np.ndarray:
        """Return a flag for each Gaussian. Raises UsageError where no subject is found."""
        from gsedit.editing.session.choose_region import find_region
        from gsedit.scene.table import gaussians_of

        from .cameras import ViewOptions, load_views

        gaussians = gaussians_of(table)
        dataset = load_views(self.scene, gaussians, ViewOptions(data=self.data), AUTO)
        found = find_region(gaussians, "auto", dataset=dataset, prompt=self.instruction)
        print_message(f"region: {found}")
        return found.inside.numpy()
