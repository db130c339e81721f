"""FLUX.1-Kontext (Black Forest Labs 2025): a transformer that reads the unedited picture as tokens.

The instruction's weight is an input of the network. Guidance with a second instruction on top of
it (true classifier-free guidance) is the image branch with s_I = 1, at twice the cost.
`v` views, `b` views at once, `n` tokens of a picture, `d` numbers each; `l` text tokens of `e`
numbers, `p` pooled ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

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
from gsedit.models.tokens import network_times, packed, tokens_over, unpacked, words

if TYPE_CHECKING:
    from gsedit.models.parts import Parts

LENGTH = 512
"""Tokens of an instruction."""
DEFAULTS = SamplerDefaults(guidance_text=2.5, guidance_image=1.0, steps=28, solver="euler")
"""Weight of its makers' example, steps of diffusers' pipeline; t_end is Stable Diffusion's."""


class TextFeatures(NamedTuple):
    """An instruction as the transformer reads it."""

    tokens: Float[Tensor, "1 l e"]
    """A vector of T5 for each token."""
    pooled: Float[Tensor, "1 p"]
    """The vector of CLIP, which reads the first 77 tokens only."""


class Condition(NamedTuple):
    """The transformer's input that no step changes."""

    reference: Float[Tensor, "v n d"]
    """Tokens of the unedited pictures."""
    text: TextFeatures
    null: TextFeatures | None
    """The instruction to push away from; None where there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Kontext(Model):
    """FLUX.1-Kontext with its text encoders."""

    transformer: Any
    clip: Any
    clip_tokenizer: Any
    t5: Any
    t5_tokenizer: Any
    flow: FlowScheduler
    guidance: float | None = DEFAULTS.guidance_text
    """The instruction's weight as an input of the network; None for one without that input."""
    negative: str | None = None
    """The instruction of the image branch, to push away from; None: there is no such branch."""
    takes_small_decoder: ClassVar[bool] = True
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Every model's; levels by size; the weight that the network reads, if it does."""
        return replace(
            super().capabilities,
            levels=self._levels,
            defaults=DEFAULTS,
            with_text_weight=None if self.guidance is None else self._with_text_weight,
        )

    @property
    def multiple(self) -> int:
        """Pixels of a token's sides."""
        return 2 * self.cell

    @property
    def size(self) -> int:
        """1024, for the real autoencoder's cells of 8 pixels."""
        return 128 * self.cell

    @property
    def text_networks(self) -> tuple[Any, ...]:
        return self.clip, self.t5

    def excess(self, prompt: str) -> int:
        """Tokens too many for T5; CLIP's part is a summary of the beginning."""
        return tokens_over(self.t5_tokenizer, prompt, LENGTH)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """The posterior's mode, shifted and scaled, float32; differentiable."""
        config = self.vae.config
        mode = encoded(self.run, self.vae, images, self.micro_batch)
        return (mode - config.shift_factor) * config.scaling_factor

    @torch.no_grad()
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        config = self.vae.config
        plain = latents / config.scaling_factor + config.shift_factor
        return decoded(self.run, self.vae, plain, self.micro_batch)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        reference = packed(self.encode(originals)).to(self.transformer.dtype)
        others = [] if self.negative is None else [self.negative]
        text, *null = self.read_once(self._embed, prompt, *others)
        return Condition(reference, text, null[0] if null else None)

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return condition._replace(reference=condition.reference[views])

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """A pass for each of (text, picture), (negative, picture), (negative, no picture) in need.

        Raises UsageError for the second and third without a negative instruction.
        """
        reference, text, null = condition
        if null is None and (need.image or need.none):
            raise UsageError(
                f"{self.name} has no branch without the instruction: leave image guidance at 1, or "
                "make the model with a negative instruction"
            )
        branches = [(text, reference), (null, reference), (null, reference[:, :0])]
        return tuple(
            self._velocity(x, t, *branch) for branch, needed in zip(branches, need) if needed
        )

    def _velocity(
        self,
        x: Float[Tensor, "b c y x"],
        t: float,
        text: TextFeatures,
        reference: Float[Tensor, "b n d"],
    ) -> Float[Tensor, "b c y x"]:
        dtype, views = self.transformer.dtype, len(x)
        places = torch.cat((_places(0, x), _places(1, x)[: reference.shape[1]]))
        weight = () if self.guidance is None else (torch.full((views,), self.guidance),)
        out = self.run(
            _flow,
            self.transformer,
            packed(x).to(dtype),
            reference,
            network_times(t, views, dtype),
            text.tokens.to(dtype).expand(views, -1, -1),
            text.pooled.to(dtype).expand(views, -1),
            places,
            *weight,
        )
        return unpacked(out.to(x.dtype), x.shape[2] // 2, x.shape[3] // 2)

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        return self.flow.levels_of(settings, (cells[0] // 2) * (cells[1] // 2))

    def _with_text_weight(self, weight: float) -> Kontext:
        return replace(self, guidance=weight)

    def _embed(self, text: str) -> TextFeatures:
        tokens = words(self.t5_tokenizer, text, LENGTH).ids
        start = words(self.clip_tokenizer, text, self.clip_tokenizer.model_max_length).ids
        return TextFeatures(self.t5(tokens).last_hidden_state, self.clip(start).pooler_output)


def load(parts: Parts, *, micro_batch: int) -> Kontext:
    """The model of a folder. Raises InputError for a schedule that is not supported."""
    from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
    from diffusers.models.transformers.transformer_flux import FluxTransformer2DModel
    from transformers import AutoTokenizer, CLIPTextModel, T5EncoderModel

    flow = FlowScheduler.read(parts.scheduler_config(), parts.folder / "scheduler")
    transformer = parts.network("transformer", FluxTransformer2DModel)
    weighted = transformer.config.guidance_embeds
    return Kontext(
        transformer=transformer,
        vae=parts.network("vae", AutoencoderKL),
        clip=parts.text_encoder("text_encoder", CLIPTextModel),
        clip_tokenizer=parts.tokenizer("tokenizer", AutoTokenizer),
        t5=parts.text_encoder("text_encoder_2", T5EncoderModel),
        t5_tokenizer=parts.tokenizer("tokenizer_2", AutoTokenizer),
        flow=flow,
        schedule=flow.schedule,
        guidance=DEFAULTS.guidance_text if weighted else None,
        negative=None if weighted else "",
        micro_batch=micro_batch,
    )


def _places(picture: int, latents: Latents) -> Float[Tensor, "n 3"]:
    """Positions of a picture's tokens: (picture, row, column)."""
    rows, columns = (torch.arange(side // 2) for side in latents.shape[2:])
    return torch.cartesian_prod(torch.tensor([picture]), rows, columns).float()


def _flow(
    transformer: Any,
    tokens: Tensor,
    reference: Tensor,
    time: Tensor,
    text: Tensor,
    pooled: Tensor,
    places: Tensor,
    *weight: Tensor,
) -> Tensor:
    """The flow at the noised picture's tokens, which come before the unedited picture's."""
    return transformer(
        hidden_states=torch.cat((tokens, reference), 1),
        timestep=time,
        guidance=weight[0] if weight else None,
        pooled_projections=pooled,
        encoder_hidden_states=text,
        txt_ids=torch.zeros(text.shape[1], 3),
        img_ids=places,
    ).sample[:, : tokens.shape[1]]
