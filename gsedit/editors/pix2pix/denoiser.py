"""InstructPix2Pix (Brooks et al. 2023) as a denoiser.

Of Stable Diffusion 1.5 (one text encoder) or SDXL (two, a pooled feature and the picture's size).
`v` views, `b` views at once, `l d` text tokens and features, `p` pooled features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.diffusion import Branches, Need, Prediction, Schedule
from gsedit.editors.protocol import Capabilities
from gsedit.errors import UsageError
from gsedit.views.padding import PadMode


class TextFeatures(NamedTuple):
    """An instruction as the UNet reads it."""

    tokens: Float[Tensor, "l d"]
    pooled: Float[Tensor, " p"] | None = None
    """Of the second text encoder (SDXL)."""


class Condition(NamedTuple):
    """The UNet's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode, *not* scaled."""
    text: TextFeatures
    null: TextFeatures
    """The empty instruction."""
    size: tuple[int, int]
    """(height, width) of the pictures in pixels: an input of SDXL."""


@dataclass(frozen=True, eq=False)
class TextEncoder:
    """A text encoder with its tokenizer."""

    network: Any
    tokenizer: Any

    def ids(self, text: str) -> Int[Tensor, "1 l"]:
        """Token numbers, cut off or filled up to what the encoder reads."""
        return self.tokenizer(
            text,
            padding="max_length",
            max_length=self.tokenizer.model_max_length,
            truncation=True,
            return_tensors="pt",
        ).input_ids

    def excess(self, text: str) -> int:
        """How many tokens of the text would be cut off."""
        tokens = len(self.tokenizer(text, truncation=False).input_ids)
        return max(0, tokens - self.tokenizer.model_max_length)


@dataclass(frozen=True, eq=False)
class Pix2Pix:
    """The Denoiser over diffusers' modules, which are used as plain callables."""

    unet: Any
    vae: Any
    text_encoders: tuple[TextEncoder, ...]
    """One of Stable Diffusion, two of SDXL."""
    schedule: Schedule
    predicts: Prediction = "eps"
    micro_batch: int = 1
    """Views in one pass of a network: memory against speed; the result is the same."""
    zeros_for_empty: bool = True
    """SDXL: the features of the empty instruction are zeros, not the encoders' output."""
    name: str = "pix2pix"
    padding: PadMode = "mirror"

    @property
    def capabilities(self) -> Capabilities:
        """It runs a network, of which a pass may hold several views, trained at one size."""
        side = self.unet.config.sample_size  # in latent cells; older files have none
        return Capabilities(
            with_micro_batch=lambda views: replace(self, micro_batch=views),
            best_size=side * self.cell if isinstance(side, int) else None,
        )

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the VAE halves the sides between its blocks."""
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

    @property
    def multiple(self) -> int:
        """Pixels: sides that the VAE and then the UNet can halve at every level, no remainder left.

        A UNet that halves an odd side meets its own skip connections only after stretching them,
        which shifts features by parts of a cell.
        """
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def channels(self) -> int:
        return self.vae.config.latent_channels

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction that is empty, or longer than the model can read."""
        if not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        excess = max(encoder.excess(prompt) for encoder in self.text_encoders)
        if excess:
            raise UsageError(
                f"the instruction is {excess} tokens (word parts) longer than this model reads, "
                "and its end would be ignored: say it in fewer words"
            )

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """The posterior's mode times the VAE's scaling factor, float32; differentiable."""
        return self._mode(images) * self.vae.config.scaling_factor

    def encode_edited(
        self,
        images: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
    ) -> Float[Tensor, "v c y x"]:
        """As encode: these latents are of the picture alone."""
        return self.encode(images)

    @torch.no_grad()
    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        latents = (latents / self.vae.config.scaling_factor).to(self.vae.dtype)
        chunks = [self.vae.decode(z).sample.float() for z in latents.split(self.micro_batch)]
        return torch.cat(chunks).movedim(1, -1) / 2 + 0.5

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        text, null = self._embed(prompt), self._embed("")
        if text.pooled is not None and self.zeros_for_empty:
            null = TextFeatures(torch.zeros_like(text.tokens), torch.zeros_like(text.pooled))
        height, width = originals.shape[1:3]
        return Condition(self._mode(originals), text, null, (height, width))

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Condition, need: Need
    ) -> Branches:
        """A UNet pass for each of (text, image), (null, image), (null, zeros) in need."""
        size = self.micro_batch
        chunks = [
            self._predict(noised, images, t, condition, need)
            for noised, images in zip(x.split(size), condition.images.split(size))
        ]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if needed else None for needed in need))

    def _predict(
        self,
        x: Float[Tensor, "b c y x"],
        images: Float[Tensor, "b c y x"],
        t: float,
        condition: Condition,
        need: Need,
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One UNet pass for a few views: the branches in need, in their order."""
        text, null = condition.text, condition.null
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        texts, shown = zip(*(branch for branch, needed in zip(branches, need) if needed))
        dtype = self.unet.dtype
        sample = torch.cat((torch.cat([x.to(images)] * len(texts)), torch.cat(shown)), 1).to(dtype)
        tokens = torch.cat([each.tokens.expand(len(x), -1, -1) for each in texts]).to(dtype)
        added = self._added(texts, len(x), condition.size)
        out = self.unet(sample, t, encoder_hidden_states=tokens, added_cond_kwargs=added).sample
        return out.to(x.dtype).chunk(len(texts))

    def _added(
        self, texts: Sequence[TextFeatures], views: int, size: tuple[int, int]
    ) -> dict[str, Tensor] | None:
        """SDXL's other inputs: pooled text; size before scaling, crop corner, size wanted."""
        pooled = [each.pooled.expand(views, -1) for each in texts if each.pooled is not None]
        if not pooled:
            return None
        ids = torch.tensor([*size, 0, 0, *size], dtype=self.unet.dtype)
        text = torch.cat(pooled).to(self.unet.dtype)
        return {"text_embeds": text, "time_ids": ids.expand(len(text), -1)}

    def _mode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """The mode of the VAE's posterior, not scaled, float32."""
        pixels = (2 * images - 1).movedim(-1, 1).to(self.vae.dtype)
        return torch.cat(
            [self.vae.encode(p).latent_dist.mode().float() for p in pixels.split(self.micro_batch)]
        )

    def _embed(self, text: str) -> TextFeatures:
        if len(self.text_encoders) == 1:
            encoder = self.text_encoders[0]
            return TextFeatures(encoder.network(encoder.ids(text))[0][0].float())
        outputs = [e.network(e.ids(text), output_hidden_states=True) for e in self.text_encoders]
        # the last but one layer of both, and the projection of the second: Podell et al. 2023
        tokens = torch.cat([each.hidden_states[-2][0].float() for each in outputs], -1)
        return TextFeatures(tokens, outputs[-1].text_embeds[0].float())
