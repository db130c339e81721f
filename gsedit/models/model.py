"""Base of the models in diffusers' layout, each of which is a Denoiser.

`v` views, `b` views at once, `c y x` latents, as a model's networks and the sampler see them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.padding import PadMode
from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Latents, Prediction
from gsedit.diffusion.schedules import Schedule
from gsedit.editor_protocol import Capabilities
from gsedit.errors import UsageError
from gsedit.models.autoencoder import decoded
from gsedit.models.runtime import Runtime, in_torch
from gsedit.models.text_networks import TextNetwork

F = TypeVar("F")
M = TypeVar("M", bound="Model")


@dataclass(frozen=True, eq=False, kw_only=True)
class Model(ABC):
    """A Denoiser over diffusers' networks; each family extends it.

    A family has the properties and methods below that are abstract, and `cell` and `channels` where
    its VAE is not diffusers' AutoencoderKL. Its networks are called through `run` alone.
    """

    schedule: Schedule
    predicts: Prediction
    vae: Any
    decoder: Any = None
    """A small decoder of latents, AutoencoderTiny; None: the VAE's own. See `small_decoder`."""
    takes_small_decoder: ClassVar[bool] = False
    """Whether such decoders exist for the latents that the family's sampler has."""
    run: Runtime = in_torch
    micro_batch: int = 1
    """Views in one pass of a network: memory against speed; the result is the same."""
    name: str = "pix2pix"
    padding: PadMode = "mirror"
    texts: dict[str, Any] = field(default_factory=dict, repr=False)
    """Features of texts that were read, see `read_once`; copies of this model share them."""

    @property
    def capabilities(self) -> Capabilities:
        """It runs a network, of which a pass may hold several views, trained at one size."""
        return Capabilities(
            with_micro_batch=lambda views: replace(self, micro_batch=views),
            best_size=self.size,
            enlarges=True,
        )

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the VAE halves the sides between its blocks."""
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

    @property
    def channels(self) -> int:
        """Channels of a latent cell."""
        return self.vae.config.latent_channels

    @property
    @abstractmethod
    def multiple(self) -> int:
        """Pixels: both sides of a picture are multiples of it."""

    @property
    @abstractmethod
    def size(self) -> int | None:
        """Pixels of the sides that it was trained at; None where its files do not say."""

    @abstractmethod
    def excess(self, prompt: str) -> int:
        """How many tokens of the instruction would be cut off."""

    @abstractmethod
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Any:
        """Everything that no step changes. Its leading dimension, where it has one, is `v`: see
        `of_views`."""

    @abstractmethod
    def of_views(self, condition: Any, views: slice) -> Any:
        """The part of a condition that belongs to some of its views."""

    @abstractmethod
    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Any, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """The branches in need, in their order, of a few views."""

    @abstractmethod
    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """Scaled latents, float32; differentiable."""

    @abstractmethod
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """Pictures of the VAE's own decoder, float32, not clamped."""

    @torch.no_grad()
    def decode(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """Pictures, float32, not clamped; of the small decoder where there is one."""
        if self.decoder is None:
            return self.decode_wholly(latents)
        config = self.decoder.config
        plain = latents / config.scaling_factor + config.shift_factor
        return decoded(self.run, self.decoder, plain, self.micro_batch)

    @property
    def text_networks(self) -> tuple[Any, ...]:
        """The encoders that only texts are read with."""
        return ()

    def read_once(self, read: Callable[[str], F], *texts: str) -> tuple[F, ...]:
        """Results of `read(text)`, which is called once for each text; then the encoders' memory,
        of billions of weights, is given back."""
        if new := [text for text in dict.fromkeys(texts) if text not in self.texts]:
            self.texts.update((text, read(text)) for text in new)
            for network in self.text_networks:
                if isinstance(network, TextNetwork):
                    network.put_away()
        return tuple(self.texts[text] for text in texts)

    def unguided(self: M, weight: float) -> M:
        """Itself, as `with_text_weight` of a distilled model. Raises UsageError for a weight."""
        if weight != 1:
            raise UsageError(
                "this model was distilled to work without guidance, and would ignore guidance "
                f"{weight:g}: leave it out"
            )
        return self

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction that is empty, or longer than the model can read."""
        if not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if excess := self.excess(prompt):
            raise UsageError(
                f"the instruction is {excess} tokens (word parts) longer than this model reads, "
                "and its end would be ignored: say it in fewer words"
            )

    def encode_edited(
        self,
        images: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
    ) -> Latents:
        """As encode: these latents are of the picture alone."""
        return self.encode(images)

    @torch.no_grad()
    def branches(self, x: Latents, t: float, condition: Any, need: Need) -> Branches:
        """Branches in need, `micro_batch` views in a pass of the network."""
        slices = [slice(i, i + self.micro_batch) for i in range(0, len(x), self.micro_batch)]
        chunks = [self.predict(x[i], t, self.of_views(condition, i), need) for i in slices]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if needed else None for needed in need))
