"""Score distillation (Poole et al. 2023), with the regulariser of Vox-E (Sella et al. 2023)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gsedit.editing.strategies._settings import (
    LEAST_NOISE,
    MOST_NOISE,
    VOX_E_WEIGHT,
    DatasetViews,
    check_noise,
    check_positive,
)
from gsedit.errors import UsageError

if TYPE_CHECKING:
    from gsedit.editing.session.actions import Action
    from gsedit.editing.session.session import Session


@dataclass(frozen=True)
class Sds:
    """Descend the denoiser's score on random views: no picture is edited.

    Raises UsageError for a value out of range, and where the editor is no diffusion model.
    """

    fits_pictures: ClassVar[bool] = False
    """It renders the scene itself, with gradients."""

    total_steps: int = 1000
    """Steps of one view each."""
    structure_weight: float = VOX_E_WEIGHT
    """Weight of the penalty that keeps opacities and base colors correlated with the unedited
    scene's (the default is Vox-E's); 0: none."""
    least_noise: float = LEAST_NOISE
    """Lowest noise level of a step."""
    most_noise: float = MOST_NOISE
    """Highest noise level of a step."""
    dataset_views: DatasetViews = "all"
    """Views that are rendered: all, or those of the plan."""

    def __post_init__(self) -> None:
        check_positive(total_steps=self.total_steps)
        check_noise(self.least_noise, self.most_noise)
        if not self.structure_weight >= 0:
            raise UsageError(f"structure weight {self.structure_weight} is not 0 or more")

    def schedule(self, session: Session) -> Iterator[Action]:
        """A few steps at a time."""
        from gsedit.editing.session.actions import MAX_STEPS_AT_ONCE
        from gsedit.editing.strategies._dataset import dataset_views
        from gsedit.editing.strategies._distil import Distil, denoiser_of

        denoiser_of(session)  # refuse what cannot be done before the first step
        views = dataset_views(session, self.dataset_views)
        for first in range(0, self.total_steps, MAX_STEPS_AT_ONCE):
            yield Distil(
                views,
                first,
                min(first + MAX_STEPS_AT_ONCE, self.total_steps),
                self.total_steps,
                self.structure_weight,
                self.least_noise,
                self.most_noise,
            )
