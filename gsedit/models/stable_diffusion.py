"""InstructPix2Pix (Brooks et al. 2023) of Stable Diffusion 1.5 and of SDXL, and CosXL-Edit.

Stable Diffusion has one text encoder; SDXL has two, a pooled feature and the picture's size.
`v` views, `b` views at once, `l d` text tokens and features, `p` pooled features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.predictions import Prediction
from gsedit.editor_protocol import Capabilities
from gsedit.errors import InputError
from gsedit.models.autoencoder import decoded, encoded
from gsedit.models.families import SDXL
from gsedit.models.model import Model
from gsedit.models.noise import Noise, noise_of
from gsedit.models.parts import Parts
from gsedit.models.tokens import tokens_over, words

XL_GUIDANCE = 5.0
"""The instruction's weight that diffusers' pipeline of SDXL has as its default."""


class TextFeatures(NamedTuple):
    """An instruction as the UNet reads it."""

    tokens: Float[Tensor, "l d"]
    pooled: Float[Tensor, " p"] | None = None
    """Pooled vector of the second text encoder (SDXL)."""


class Condition(NamedTuple):
    """The UNet's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode; scaled for CosXL-Edit alone."""
    text: TextFeatures
    null: TextFeatures
    """Features of the empty instruction."""
    size: tuple[int, int]
    """(height, width) of the pictures in pixels: an input of SDXL."""


@dataclass(frozen=True, eq=False)
class TextEncoder:
    """A text encoder with its tokenizer."""

    network: Any
    tokenizer: Any

    def ids(self, text: str) -> Int[Tensor, "1 l"]:
        """Token numbers, cut off or filled up to what the encoder reads."""
        return words(self.tokenizer, text, self.tokenizer.model_max_length).ids

    def excess(self, text: str) -> int:
        """How many tokens of the text would be cut off."""
        return tokens_over(self.tokenizer, text, self.tokenizer.model_max_length)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pix2Pix(Model):
    """InstructPix2Pix: a UNet that sees the unedited picture beside the noised one."""

    unet: Any
    text_encoders: tuple[TextEncoder, ...]
    """One of Stable Diffusion, two of SDXL."""
    takes_small_decoder: ClassVar[bool] = True
    predicts: Prediction = "eps"
    zeros_for_empty: bool = True
    """SDXL: the features of the empty instruction are zeros, not the encoders' output."""
    scaled_images: bool = False
    """CosXL-Edit: the unedited pictures' latents are scaled too."""
    noise: Noise | None = None
    """The scheduler's levels and defaults; None: those of the settings."""

    @property
    def capabilities(self) -> Capabilities:
        """Every model's, with the scheduler's levels and defaults."""
        declared = super().capabilities
        if self.noise is None:
            return declared
        return replace(declared, levels=self.noise.levels, defaults=self.noise.defaults)

    @property
    def size(self) -> int | None:
        side = self.unet.config.sample_size  # in latent cells; older files have none
        return side * self.cell if isinstance(side, int) else None

    @property
    def multiple(self) -> int:
        """Pixels: sides that the VAE and then the UNet can halve at every level, no remainder left.

        A UNet that halves an odd side meets its own skip connections only after stretching them,
        which shifts features by parts of a cell.
        """
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def text_networks(self) -> tuple[Any, ...]:
        return tuple(encoder.network for encoder in self.text_encoders)

    def excess(self, prompt: str) -> int:
        return max(encoder.excess(prompt) for encoder in self.text_encoders)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """The posterior's mode times the VAE's scaling factor, float32; differentiable."""
        return self._mode(images) * self.vae.config.scaling_factor

    @torch.no_grad()
    def decode_wholly(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        latents = latents / self.vae.config.scaling_factor
        return decoded(self.run, self.vae, latents, self.micro_batch)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        text, null = self.read_once(self._embed, prompt, "")
        if text.pooled is not None and self.zeros_for_empty:
            null = TextFeatures(torch.zeros_like(text.tokens), torch.zeros_like(text.pooled))
        images = self.encode(originals) if self.scaled_images else self._mode(originals)
        height, width = originals.shape[1:3]
        return Condition(images, text, null, (height, width))

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return condition._replace(images=condition.images[views])

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One UNet pass for (text, image), (null, image), (null, zeros), as far as in need."""
        text, null, images = condition.text, condition.null, condition.images
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        texts, shown = zip(*(branch for branch, needed in zip(branches, need) if needed))
        dtype = self.unet.dtype
        sample = torch.cat((torch.cat([x.to(images)] * len(texts)), torch.cat(shown)), 1).to(dtype)
        tokens = torch.cat([each.tokens.expand(len(x), -1, -1) for each in texts]).to(dtype)
        added = self._added(texts, len(x), condition.size)
        time = torch.full((len(sample),), t, dtype=torch.float32)
        out = self.run(_predicted, self.unet, sample, time, tokens, *added)
        return out.to(x.dtype).chunk(len(texts))

    def _added(
        self, texts: Sequence[TextFeatures], views: int, size: tuple[int, int]
    ) -> tuple[Tensor, ...]:
        """SDXL's other inputs: pooled text; size before scaling, crop corner, size wanted."""
        pooled = [each.pooled.expand(views, -1) for each in texts if each.pooled is not None]
        if not pooled:
            return ()
        ids = torch.tensor([*size, 0, 0, *size], dtype=self.unet.dtype)
        text = torch.cat(pooled).to(self.unet.dtype)
        return text, ids.repeat(len(text), 1)

    def _mode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        return encoded(self.run, self.vae, images, self.micro_batch)

    def _embed(self, text: str) -> TextFeatures:
        if len(self.text_encoders) == 1:
            encoder = self.text_encoders[0]
            return TextFeatures(encoder.network(encoder.ids(text))[0][0].float())
        outputs = [e.network(e.ids(text), output_hidden_states=True) for e in self.text_encoders]
        # the last but one layer of both, and the projection of the second: Podell et al. 2023
        tokens = torch.cat([each.hidden_states[-2][0].float() for each in outputs], -1)
        return TextFeatures(tokens, outputs[-1].text_embeds[0].float())


def _predicted(unet: Any, sample: Tensor, time: Tensor, tokens: Tensor, *added: Tensor) -> Tensor:
    kwargs = dict(zip(("text_embeds", "time_ids"), added)) or None
    return unet(sample, time, encoder_hidden_states=tokens, added_cond_kwargs=kwargs).sample


def load(parts: Parts, *, micro_batch: int) -> Pix2Pix:
    """The model of a folder. Raises InputError for a schedule or latents that are not supported."""
    import transformers
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel

    noise = noise_of(parts.scheduler_config(), parts.folder / "scheduler")
    kinds: dict[str, Any] = {"text_encoder": transformers.CLIPTextModel}
    settings = parts.pipeline_config()
    if parts.family == SDXL:
        kinds["text_encoder_2"] = transformers.CLIPTextModelWithProjection
        noise = noise._replace(defaults=noise.defaults._replace(guidance_text=XL_GUIDANCE))
    vae = parts.network("vae", AutoencoderKL)
    if getattr(vae.config, "latents_mean", None) is not None:
        raise InputError(
            f"{parts.folder / 'vae'}: latents with a mean (latents_mean) are not supported"
        )
    return Pix2Pix(
        unet=parts.network("unet", UNet2DConditionModel),
        vae=vae,
        text_encoders=tuple(
            TextEncoder(
                parts.text_encoder(name, kind),
                parts.tokenizer(
                    name.replace("text_encoder", "tokenizer"), transformers.CLIPTokenizer
                ),
            )
            for name, kind in kinds.items()
        ),
        schedule=noise.schedule,
        predicts=noise.predicts,
        noise=noise,
        micro_batch=micro_batch,
        zeros_for_empty=settings.get("force_zeros_for_empty_prompt", True),
        scaled_images=bool(settings.get("is_cosxl_edit", False)),
    )
