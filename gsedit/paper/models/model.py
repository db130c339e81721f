"""Base of the models in diffusers' layout, each a Denoiser; their autoencoders and texts.

`v` views of `h w` pixels, `b` views at once, `c y x` latents.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any, NamedTuple, TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Branches, Latents, Need, Prediction
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.editors.protocol import Capabilities
from gsedit.paper.models.runtime import Runtime, in_torch
from gsedit.views.image_ops import PadMode

F = TypeVar("F")


class TextNetwork:
    """A text encoder, called as its network is. Its weights take memory only while it is used."""

    def __init__(self, load: Callable[[], Any]) -> None:
        self._load = load
        self._network = load()  # which says now what is wrong with it

    @property
    def network(self) -> Any:
        """The network; loaded again where it was put away."""
        if self._network is None:
            self._network = self._load()
        return self._network

    def __call__(self, *inputs: Any, **options: Any) -> Any:
        """The output of the network."""
        return self.network(*inputs, **options)

    def put_away(self) -> None:
        """Drop the weights from memory."""
        self._network = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Model(ABC):
    """A Denoiser over diffusers' networks; each family extends it.

    A family has the properties and methods below that are abstract, and `cell` where its VAE is not
    diffusers' AutoencoderKL. Its networks are called through `run` alone.
    """

    schedule: Schedule
    predicts: Prediction
    vae: Any
    run: Runtime = in_torch
    name: str = "pix2pix"
    padding: PadMode = "mirror"
    texts: dict[str, Any] = field(default_factory=dict, repr=False)
    """Features of texts that were read, see `read_once`; copies of this model share them."""

    @property
    def capabilities(self) -> Capabilities:
        """It runs a network that was trained at one size."""
        return Capabilities(runs_network=True, best_size=self.size, enlarges=True)

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the VAE halves the sides between its blocks."""
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

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
        """Everything that no step changes, as a NamedTuple; the rows of its `images` are views."""

    @abstractmethod
    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Any, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """The branches in need, in their order, of a few views."""

    @property
    def shift(self) -> float:
        """Number that is taken from latents before they are scaled."""
        return getattr(self.vae.config, "shift_factor", None) or 0.0

    def mode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """Latents of the VAE, not scaled, float32; differentiable."""
        parts = (2 * images - 1).movedim(-1, 1).to(self.vae.dtype).split(1)
        return torch.cat([self.run(mode_of, self.vae, part).float() for part in parts])

    def pictures(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """Pictures of latents as the VAE's decoder takes them, float32, not clamped."""
        parts = latents.to(self.vae.dtype).split(1)
        images = torch.cat([self.run(picture_of, self.vae, part).float() for part in parts])
        return images.movedim(1, -1) / 2 + 0.5

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """Latents scaled as the sampler has them, float32; differentiable."""
        return (self.mode(images) - self.shift) * self.vae.config.scaling_factor

    @torch.no_grad()
    def decode(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """Pictures, float32, not clamped."""
        return self.pictures(latents / self.vae.config.scaling_factor + self.shift)

    @property
    def text_networks(self) -> tuple[TextNetwork, ...]:
        """The encoders that only texts are read with."""
        return ()

    def read_once(self, read: Callable[[str], F], *texts: str) -> tuple[F, ...]:
        """Results of `read(text)`, which is called once for each text; then the encoders' memory,
        of billions of weights, is given back."""
        if new := [text for text in dict.fromkeys(texts) if text not in self.texts]:
            self.texts.update((text, read(text)) for text in new)
            for network in self.text_networks:
                network.put_away()
        return tuple(self.texts[text] for text in texts)

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
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Latents:
        """As encode: these latents are of the picture alone."""
        return self.encode(images)

    @torch.no_grad()
    def branches(self, x: Latents, t: float, condition: Any, need: Need) -> Branches:
        """Branches in need, a view in a pass of the network."""
        own = [condition._replace(images=each) for each in condition.images.split(1)]
        chunks = [self.predict(*both, need) for both in zip(x.split(1), repeat(t), own)]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if needed else None for needed in need))


# ---- pictures to latents and back ----------------------------------------------------------------


def mode_of(vae: Any, pixels: Tensor) -> Tensor:
    """The posterior's mode of pixels in [-1, 1]."""
    encoding = vae.encode(pixels)
    # AutoencoderTiny (TAESD's architecture) has no distribution
    return encoding.latents if "latents" in encoding else encoding.latent_dist.mode()


def picture_of(vae: Any, latents: Tensor) -> Tensor:
    """Pixels in about [-1, 1] of latents."""
    return vae.decode(latents).sample


# ---- texts ---------------------------------------------------------------------------------------


class Words(NamedTuple):
    """An instruction as a text encoder reads it."""

    ids: Int[Tensor, "1 l"]
    mask: Int[Tensor, "1 l"]
    """0 for the tokens that only fill it up."""


def words(tokenizer: Any, text: str, length: int) -> Words:
    """Token numbers, cut off or filled up to the length."""
    inputs = tokenizer(
        text, padding="max_length", max_length=length, truncation=True, return_tensors="pt"
    )
    return Words(inputs.input_ids, inputs.attention_mask)


def tokens_over(tokenizer: Any, text: str, length: int) -> int:
    """How many tokens of the text would be cut off."""
    return max(0, len(tokenizer(text, truncation=False).input_ids) - length)
