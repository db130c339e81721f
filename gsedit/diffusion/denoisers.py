"""What the sampler asks of a diffusion model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import Schedule

Answer = Callable[[Tensor], Tensor]
"""A map from unedited to truly edited pictures [n h w 3]."""


@runtime_checkable
class Predictor(Protocol):
    """As much of a diffusion model as sampling needs: answers, and what they mean."""

    @property
    def name(self) -> str: ...

    @property
    def schedule(self) -> Schedule: ...

    @property
    def predicts(self) -> Prediction:
        """What `branches` answers."""
        ...

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The prediction under each condition that is needed, in any floating dtype."""
        ...


@runtime_checkable
class Denoiser(Predictor, Protocol):
    """A diffusion model of edited images, in its own latent space. Stateless.

    A frozen dataclass with a field `micro_batch` (views in one pass of its network; 1: choose) is
    given as many as memory allows, and may be asked for its products in bfloat16. An attribute
    `suits` (see Suits) says which guidance and temperature are used unless others are asked for.
    """

    @property
    def cell(self) -> int:
        """Pixels per latent cell; image sides are multiples of it."""
        ...

    @property
    def channels(self) -> int: ...

    def check(self, prompt: str) -> None:
        """Raise UsageError, with the next move, for an instruction it cannot follow."""
        ...

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """Latents, scaled as the sampler wants them, of images in [0, 1]."""
        ...

    def encode_edited(
        self,
        images: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
    ) -> Float[Tensor, "v c y x"]:
        """Latents of finished edits of these originals: what anchored views are held to."""
        ...

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """Images, not clamped: the inverse of encode as far as there is one."""
        ...

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Any:
        """Whatever `branches` needs and no step changes; computed once for the views."""
        ...

    def answer(
        self,
        prompt: str,
        edited: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
    ) -> Answer | None:
        """The true edit that most of these views show; None for a model that knows of none."""
        ...
