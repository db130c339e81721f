"""Qwen-Image-Edit and Qwen-Image-Edit-Plus (arXiv 2508.02324): a transformer of two pictures.

Its tokens are 2 x 2 latent cells: those of the noised picture, then those of the unedited one. The
instruction is read beside the unedited picture too. `v` views, `b` views at once, `c y x` latents,
`n p` tokens and their numbers, `l d` text tokens and features.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.predictions import Latents, Prediction
from gsedit.diffusion.schedules import NoiseLevel
from gsedit.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.editor_protocol import Capabilities
from gsedit.errors import UsageError
from gsedit.models.autoencoder import decoded, encoded
from gsedit.models.model import Model
from gsedit.models.tokens import network_times, packed, unpacked
from gsedit.models.vision_language import Reader, load_reader

if TYPE_CHECKING:
    from gsedit.models.parts import Parts

PATCH = 2  # latent cells along a side of a token
TRAINED_SIDE = 1024  # pixels; of a square picture
READ_AREA = 384**2  # pixels of the picture that Plus shows to its text encoder
READ_MULTIPLE = 32  # pixels; sides of that picture are multiples of it
LONGEST = 1024  # tokens of an instruction, as diffusers says
HEADING = "Picture 1: "
"""Words of Plus, which can be shown several pictures, before the first."""
NO_INSTRUCTION = " "  # what the authors ask instead of nothing
DEFAULTS = SamplerDefaults(guidance_text=4.0, guidance_image=1.0, steps=50, solver="euler")


class Condition(NamedTuple):
    """The transformer's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures."""
    text: Float[Tensor, "v l d"]
    null: Float[Tensor, "v k d"]
    """Features of no instruction beside the same pictures."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QwenImageEdit(Model):
    """Qwen-Image-Edit; with `plus` its text encoder is shown the picture at a size of its own."""

    transformer: Any
    reader: Reader
    scheduler: FlowScheduler
    plus: bool
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Noise levels that depend on the picture's size; guidance that keeps a token's norm."""
        return replace(
            super().capabilities, defaults=DEFAULTS, levels=self._levels, rescale=with_norm_of
        )

    @property
    def cell(self) -> int:
        return 2 ** len(self.vae.config.temperal_downsample)

    @property
    def multiple(self) -> int:
        return PATCH * self.cell

    @property
    def channels(self) -> int:
        return self.vae.config.z_dim

    @property
    def size(self) -> int:
        return TRAINED_SIDE

    def excess(self, prompt: str) -> int:
        return self.reader.excess(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """The posterior's mode, less its channels' mean, in units of their deviation."""
        mean, deviation = self._statistics
        mode = encoded(self.run, self.vae, images, self.micro_batch, _mode)
        return (mode - mean) / deviation

    @torch.no_grad()
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        mean, deviation = self._statistics
        plain = latents * deviation + mean
        return decoded(self.run, self.vae, plain, self.micro_batch, _picture)

    @property
    def _statistics(self) -> tuple[Float[Tensor, "c 1 1"], Float[Tensor, "c 1 1"]]:
        config = self.vae.config
        mean, deviation = torch.tensor([config.latents_mean, config.latents_std])[..., None, None]
        return mean, deviation

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Every view's text is read beside its own picture; `generator` is not used."""
        text, null = (self._read(originals, each) for each in (prompt, NO_INSTRUCTION))
        return Condition(self.encode(originals), text, null)

    def _read(self, originals: Float[Tensor, "v h w 3"], text: str) -> Float[Tensor, "v l d"]:
        height, width = originals.shape[1:3]
        size = reading_size(height, width) if self.plus else (height, width)
        return self.reader.features(originals, text, size, self.micro_batch)

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return Condition(*(part[views] for part in condition))

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One pass a branch, since their texts differ in length; there is none without a picture.

        Raises UsageError where guidance by the picture asks for that one.
        """
        if need.none:
            raise UsageError(f"{self.name} has no image guidance: leave it at 1")
        dtype = self.transformer.dtype
        time = network_times(t, len(x), dtype)
        inputs = (x.to(dtype), condition.images.to(dtype), time)
        texts = [text for text, needed in zip((condition.text, condition.null), need) if needed]
        return tuple(
            self.run(_predicted, self.transformer, *inputs, text.to(dtype)).to(x.dtype)
            for text in texts
        )

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        return self.scheduler.levels_of(settings, cells[0] * cells[1] // PATCH**2)


def reading_size(height: int, width: int) -> tuple[int, int]:
    """(height, width) of READ_AREA pixels and nearly this picture's proportions."""
    ideal = math.sqrt(READ_AREA * width / height)
    sides = (ideal * height / width, ideal)
    rows, columns = (max(round(side / READ_MULTIPLE), 1) * READ_MULTIPLE for side in sides)
    return rows, columns


def with_norm_of(guided: Latents, shown: Latents) -> Latents:
    """The guided prediction, every token of which has the length that it has without guidance."""
    rows, columns = _places(guided)
    tokens, unguided = packed(guided), packed(shown)
    tokens = tokens * (unguided.norm(dim=-1, keepdim=True) / tokens.norm(dim=-1, keepdim=True))
    return unpacked(tokens, rows, columns)


def _places(latents: Latents) -> tuple[int, int]:
    """Rows and columns of tokens."""
    return latents.shape[2] // PATCH, latents.shape[3] // PATCH


def _predicted(transformer: Any, x: Tensor, images: Tensor, time: Tensor, text: Tensor) -> Tensor:
    tokens, places = packed(x), _places(x)
    out = transformer(
        hidden_states=torch.cat((tokens, packed(images)), 1),
        timestep=time,
        encoder_hidden_states=text,
        img_shapes=[[(1, *places)] * 2] * len(x),
    ).sample
    return unpacked(out[:, : tokens.shape[1]], *places)


def _mode(vae: Any, pixels: Tensor) -> Tensor:
    """The VAE is one of videos: a picture is a video of one frame."""
    return vae.encode(pixels[:, :, None]).latent_dist.mode()[:, :, 0]


def _picture(vae: Any, latents: Tensor) -> Tensor:
    return vae.decode(latents[:, :, None]).sample[:, :, 0]


def load(parts: Parts, *, micro_batch: int) -> QwenImageEdit:
    """The Qwen-Image-Edit or Qwen-Image-Edit-Plus of a folder. Raises InputError."""
    from diffusers.models.autoencoders.autoencoder_kl_qwenimage import AutoencoderKLQwenImage
    from diffusers.models.transformers.transformer_qwenimage import QwenImageTransformer2DModel
    from transformers import Qwen2_5_VLForConditionalGeneration

    plus = parts.pipeline == "QwenImageEditPlusPipeline"
    heading = HEADING if plus else ""
    scheduler = FlowScheduler.read(parts.scheduler_config(), parts.folder / "scheduler")
    return QwenImageEdit(
        transformer=parts.network("transformer", QwenImageTransformer2DModel),
        vae=_convertible(parts.network("vae", AutoencoderKLQwenImage)),
        reader=load_reader(
            parts, Qwen2_5_VLForConditionalGeneration, heading=heading, most=LONGEST
        ),
        scheduler=scheduler,
        schedule=scheduler.schedule,
        plus=plus,
        micro_batch=micro_batch,
        name="qwen-image-edit-plus" if plus else "qwen-image-edit",
    )


def _convertible(vae: Any) -> Any:
    """The VAE without an operation that OpenVINO lacks: sides are doubled alike by both kinds."""
    for module in vae.modules():
        if getattr(module, "mode", None) == "nearest-exact":
            module.mode = "nearest"
    return vae
