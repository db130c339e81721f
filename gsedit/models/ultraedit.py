"""UltraEdit (Zhao et al. 2024) and other InstructPix2Pix of Stable Diffusion 3.

A transformer sees the unedited picture's latents beside the noised ones. Two CLIP encoders and
T5, which may be missing, read the instruction.
`v` views, `b` views at once, `m y x` latents shown beside the noised `c y x`; `l` text tokens of
`e` numbers, `p` pooled ones.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.predictions import Latents, Prediction
from gsedit.diffusion.schedules import NoiseLevel
from gsedit.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.editor_protocol import Capabilities
from gsedit.errors import InputError
from gsedit.models.autoencoder import decoded, encoded
from gsedit.models.model import Model
from gsedit.models.stable_diffusion import TextEncoder
from gsedit.models.tokens import tokens_over, words

if TYPE_CHECKING:
    from gsedit.models.parts import Parts

DEFAULTS = SamplerDefaults(guidance_text=7.5, guidance_image=1.5, steps=28, solver="euler")
"""Weights of UltraEdit's example, steps of diffusers' pipeline; t_end is Stable Diffusion's."""
OWN_VERSION = (0, 33)
"""Diffusers before it had no pipeline of this name but in UltraEdit's copy of it."""
OWN_SIZE = 512
"""Pixels that UltraEdit was trained at; its files have Stable Diffusion 3's 1024."""
OWN_LENGTH, LENGTH = 77, 256
"""Tokens of T5, in UltraEdit and in diffusers' pipeline."""


class TextFeatures(NamedTuple):
    """An instruction as the transformer reads it."""

    tokens: Float[Tensor, "1 l e"]
    pooled: Float[Tensor, "1 p"]


class Condition(NamedTuple):
    """The transformer's input that no step changes."""

    images: Float[Tensor, "v m y x"]
    """Latents of the unedited pictures, and of the mask where the model is shown one."""
    text: TextFeatures
    null: TextFeatures
    """Features of the empty instruction."""


@dataclass(frozen=True, eq=False, kw_only=True)
class UltraEdit(Model):
    """InstructPix2Pix of Stable Diffusion 3."""

    transformer: Any
    clips: tuple[TextEncoder, TextEncoder]
    t5: TextEncoder | None
    """Without it, zeros are in its place, as in Stable Diffusion 3."""
    flow: FlowScheduler
    own: bool = False
    """UltraEdit's own weights: latents are scaled but not shifted, the pictures shown are neither.
    Otherwise all are both, as in diffusers' pipeline."""
    takes_small_decoder: ClassVar[bool] = True
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Every model's, with its own levels and defaults."""
        return replace(super().capabilities, levels=self._levels, defaults=DEFAULTS)

    @property
    def multiple(self) -> int:
        """Pixels of a patch's sides."""
        return self.transformer.config.patch_size * self.cell

    @property
    def size(self) -> int:
        return OWN_SIZE if self.own else self.transformer.config.sample_size * self.cell

    @property
    def length(self) -> int:
        """Tokens that T5 reads."""
        return OWN_LENGTH if self.own else LENGTH

    @property
    def text_networks(self) -> tuple[Any, ...]:
        return tuple(each.network for each in (*self.clips, self.t5) if each is not None)

    def excess(self, prompt: str) -> int:
        """Tokens too many for T5, where it is there: it reads what CLIP has no room for."""
        if self.t5 is None:
            return max(clip.excess(prompt) for clip in self.clips)
        return tokens_over(self.t5.tokenizer, prompt, self.length)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """The posterior's mode, shifted and scaled, float32; differentiable."""
        return self._scaled(encoded(self.run, self.vae, images, self.micro_batch))

    @torch.no_grad()
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        plain = latents / self.vae.config.scaling_factor + self._shift
        return decoded(self.run, self.vae, plain, self.micro_batch)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        images = self._shown(originals)
        if self.transformer.config.in_channels == 3 * self.channels:
            everywhere = self._shown(torch.ones_like(originals[:1]))  # the mask of a free edit
            images = torch.cat((images, everywhere.expand_as(images)), 1)
        return Condition(images, *self.read_once(self._embed, prompt, ""))

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return condition._replace(images=condition.images[views])

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """A pass for each of (text, picture), (null, picture), (null, zeros) in need."""
        images, text, null = condition
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        return tuple(
            self._velocity(x, t, *branch) for branch, needed in zip(branches, need) if needed
        )

    def _velocity(
        self,
        x: Float[Tensor, "b c y x"],
        t: float,
        text: TextFeatures,
        images: Float[Tensor, "b m y x"],
    ) -> Float[Tensor, "b c y x"]:
        dtype, views = self.transformer.dtype, len(x)
        out = self.run(
            _flow,
            self.transformer,
            torch.cat((x.to(dtype), images.to(dtype)), 1),
            torch.full((views,), t, dtype=torch.float32),
            text.tokens.to(dtype).expand(views, -1, -1),
            text.pooled.to(dtype).expand(views, -1),
        )
        return out.to(x.dtype)

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        patch = self.transformer.config.patch_size
        tokens = (cells[0] // patch) * (cells[1] // patch)
        return self.flow.levels_of(settings, tokens, "to training's end")

    @property
    def _shift(self) -> float:
        return 0.0 if self.own else self.vae.config.shift_factor

    def _scaled(self, mode: Latents) -> Latents:
        return (mode - self._shift) * self.vae.config.scaling_factor

    def _shown(self, pictures: Float[Tensor, "v h w 3"]) -> Latents:
        mode = encoded(self.run, self.vae, pictures, self.micro_batch)
        return mode if self.own else self._scaled(mode)

    def _embed(self, text: str) -> TextFeatures:
        outputs = [c.network(c.ids(text), output_hidden_states=True) for c in self.clips]
        # the last layer but one of both, as in SDXL
        tokens = torch.cat([each.hidden_states[-2] for each in outputs], -1)
        if self.t5 is None:
            more = tokens.new_zeros(1, self.length, self.transformer.config.joint_attention_dim)
        else:
            ids = words(self.t5.tokenizer, text, self.length).ids
            more = self.t5.network(ids).last_hidden_state.to(tokens.dtype)
        tokens = pad(tokens, (0, more.shape[-1] - tokens.shape[-1]))
        pooled = torch.cat([each.text_embeds for each in outputs], -1)
        return TextFeatures(torch.cat((tokens, more), 1), pooled)


def load(parts: Parts, *, micro_batch: int) -> UltraEdit:
    """The model of a folder. Raises InputError for what is not supported."""
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.transformers.transformer_sd3 import SD3Transformer2DModel
    from transformers import AutoTokenizer, CLIPTextModelWithProjection, T5EncoderModel

    flow = FlowScheduler.read(parts.scheduler_config(), parts.folder / "scheduler")

    def encoder(number: str, kind: Any) -> TextEncoder:
        network = parts.text_encoder(f"text_encoder{number}", kind)
        return TextEncoder(network, parts.tokenizer(f"tokenizer{number}", AutoTokenizer))

    model = UltraEdit(
        transformer=parts.network("transformer", SD3Transformer2DModel),
        vae=parts.network("vae", AutoencoderKL),
        clips=(
            encoder("", CLIPTextModelWithProjection),
            encoder("_2", CLIPTextModelWithProjection),
        ),
        t5=encoder("_3", T5EncoderModel) if parts.has("text_encoder_3") else None,
        flow=flow,
        schedule=flow.schedule,
        own=_made_by_ultraedit(parts.pipeline_config()),
        micro_batch=micro_batch,
    )
    taken, latent = model.transformer.config.in_channels, model.channels
    if taken not in (2 * latent, 3 * latent):
        raise InputError(
            f"{parts.folder / 'transformer'} takes {taken} channels, not {2 * latent} or "
            f"{3 * latent}: it is no InstructPix2Pix, which is shown the unedited picture"
        )
    return model


def _made_by_ultraedit(pipeline: dict[str, Any]) -> bool:
    """Whether a model_index.json was written by UltraEdit's copy of diffusers."""
    version = re.match(r"(\d+)\.(\d+)", str(pipeline.get("_diffusers_version", "")))
    return version is not None and tuple(map(int, version.groups())) < OWN_VERSION


def _flow(transformer: Any, sample: Tensor, time: Tensor, text: Tensor, pooled: Tensor) -> Tensor:
    return transformer(
        hidden_states=sample,
        timestep=time,
        encoder_hidden_states=text,
        pooled_projections=pooled,
    ).sample
