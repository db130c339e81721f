"""DreamLite (arXiv 2603.28713) and DreamLite-mobile: a U-Net that edits half of a canvas.

The U-Net sees the noised latents beside those of the unedited picture, on one canvas twice as
wide; what it predicts for the left half is the edit's. Both read the instruction beside the
picture. `v` views, `b` views at once, `l d` text tokens and features.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.predictions import Latents, Prediction
from gsedit.diffusion.schedules import NoiseLevel
from gsedit.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.editor_protocol import Capabilities
from gsedit.models.autoencoder import decoded, encoded
from gsedit.models.model import Model
from gsedit.models.vision_language import Reader, load_reader

if TYPE_CHECKING:
    from gsedit.models.parts import Parts

READ_AT = (512, 512)  # height and width at which the text encoder sees every picture
LONGEST = 200  # tokens of an instruction, as diffusers cuts them where no picture is read
INSTRUCTION = (
    "[Edit]: A diptych with two side-by-side images of the same scene. "
    "Compared to the right side, the left one has {}"
)
TRAINED_CELLS = 128  # sides of the pictures that it was trained on, in latent cells
DEFAULTS = SamplerDefaults(guidance_text=3.5, guidance_image=1.5, steps=30, solver="euler")
MOBILE_DEFAULTS = SamplerDefaults(
    guidance_text=1.0, guidance_image=1.0, t_end=1.2, steps=4, solver="euler"
)
"""t_end: three steps of four at every size up to 1024 pixels. A guess, since it was measured with
an exact score alone (docs/measurements/sampler.md)."""


class Condition(NamedTuple):
    """The U-Net's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures, not scaled."""
    text: Float[Tensor, "v l d"]
    null: Float[Tensor, "v k d"] | None
    """Features of the empty instruction beside the same pictures; None for DreamLite-mobile."""
    size: tuple[int, int]
    """(width, height) of the pictures in pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DreamLite(Model):
    """DreamLite; with `distilled` DreamLite-mobile, which has no guidance and few steps."""

    unet: Any
    reader: Reader
    scheduler: FlowScheduler
    distilled: bool
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Noise levels that depend on the picture's size; no guidance of a distilled model."""
        return replace(
            super().capabilities,
            defaults=MOBILE_DEFAULTS if self.distilled else DEFAULTS,
            levels=self._levels,
            with_text_weight=self.unguided if self.distilled else None,
        )

    @property
    def cell(self) -> int:
        return 2 ** (len(self.vae.config.encoder_block_out_channels) - 1)

    @property
    def multiple(self) -> int:
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def size(self) -> int:
        return TRAINED_CELLS * self.cell

    def excess(self, prompt: str) -> int:
        return self.reader.excess(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        latents = encoded(self.run, self.vae, images, self.micro_batch)
        return (latents - self._shift) * self.vae.config.scaling_factor

    @torch.no_grad()
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        latents = latents / self.vae.config.scaling_factor + self._shift
        return decoded(self.run, self.vae, latents, self.micro_batch)

    @property
    def _shift(self) -> float:
        return self.vae.config.shift_factor or 0.0

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Every view's text is read beside its own picture; `generator` is not used."""
        images = encoded(self.run, self.vae, originals, self.micro_batch)
        text = self._read(originals, INSTRUCTION.format(prompt))
        null = None if self.distilled else self._read(originals, "")
        height, width = originals.shape[1:3]
        return Condition(images, text, null, (width, height))

    def _read(self, originals: Float[Tensor, "v h w 3"], text: str) -> Float[Tensor, "v l d"]:
        return self.reader.features(originals, text, READ_AT, self.micro_batch)

    def of_views(self, condition: Condition, views: slice) -> Condition:
        null = condition.null
        return condition._replace(
            images=condition.images[views],
            text=condition.text[views],
            null=None if null is None else null[views],
        )

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One U-Net pass for (text, image), (null, image), (null, zeros), as far as in need."""
        text, null, images = condition.text, condition.null, condition.images
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        texts, shown = zip(*(branch for branch, needed in zip(branches, need) if needed))
        dtype = self.unet.dtype
        targets = torch.cat([x.to(images)] * len(texts))
        canvas = torch.cat((targets, torch.cat(shown)), -1).to(dtype)
        tokens, mask = _filled_up(texts)
        time = torch.full((len(canvas),), t, dtype=torch.float32)
        sizes = torch.tensor(condition.size, dtype=torch.float32).expand(len(canvas), -1)
        out = self.run(_predicted, self.unet, canvas, time, tokens.to(dtype), mask, sizes)
        return out[..., : x.shape[-1]].to(x.dtype).chunk(len(texts))

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        """Levels for latents of so many rows and columns: a token is 2 x 2 cells."""
        return self.scheduler.levels_of(settings, cells[0] * cells[1] // 4)


def _filled_up(
    texts: tuple[Float[Tensor, "b _ d"], ...],
) -> tuple[Float[Tensor, "n l d"], Float[Tensor, "n l"]]:
    """(features of all branches filled up with zeros to one length, 1 where there is a token)."""
    length = max(text.shape[1] for text in texts)
    rows = [(F.pad(text, (0, 0, 0, length - text.shape[1])), text.shape[1]) for text in texts]
    masks = [(torch.arange(length) < tokens).float().expand(len(row), -1) for row, tokens in rows]
    return torch.cat([row for row, _ in rows]), torch.cat(masks)


def _predicted(
    unet: Any, canvas: Tensor, time: Tensor, tokens: Tensor, mask: Tensor, sizes: Tensor
) -> Tensor:
    return unet(
        canvas,
        time,
        encoder_hidden_states=tokens,
        encoder_attention_mask=mask,
        added_cond_kwargs={"time_ids": sizes},
    ).sample


def load(parts: Parts, *, micro_batch: int) -> DreamLite:
    """The DreamLite or DreamLite-mobile of a folder. Raises InputError."""
    from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny
    from diffusers.models.unets.unet_dreamlite import DreamLiteUNetModel
    from transformers import Qwen3VLForConditionalGeneration

    scheduler = FlowScheduler.read(parts.scheduler_config(), parts.folder / "scheduler")
    distilled = parts.pipeline == "DreamLiteMobilePipeline"
    return DreamLite(
        unet=parts.network("unet", DreamLiteUNetModel),
        vae=parts.network("vae", AutoencoderTiny),
        reader=load_reader(parts, Qwen3VLForConditionalGeneration, most=LONGEST),
        scheduler=scheduler,
        schedule=scheduler.schedule,
        distilled=distilled,
        micro_batch=micro_batch,
        name="dreamlite-mobile" if distilled else "dreamlite",
    )
