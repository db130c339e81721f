"""What the sampler needs of a diffusion model."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import Schedule


@runtime_checkable
class Predictor(Protocol):
    """A diffusion model without its latent space: predictions, and what they are of. Stateless."""

    @property
    def name(self) -> str:
        """Named in error messages."""
        ...

    @property
    def schedule(self) -> Schedule:
        """The noise levels it was trained at."""
        ...

    @property
    def predicts(self) -> Prediction:
        """The quantity that `branches` returns."""
        ...

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The prediction at x_t under each condition in `need`, in any floating dtype.

        `t` is a training step, between two of them where the schedule is interpolated.
        """
        ...
