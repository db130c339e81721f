"""InstructPix2Pix (Brooks et al. 2023) of Stable Diffusion 1.5 and of SDXL.

Stable Diffusion has one text encoder; SDXL has two, a pooled feature and the picture's size.
`v` views, `b` views at once, `l d` text tokens and features, `p` pooled features.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.errors import InputError
from gsedit.paper.diffusion.guidance import Need, Prediction
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.editors.protocol import Capabilities
from gsedit.paper.models.hub import SDXL
from gsedit.paper.models.loading import Parts, explained
from gsedit.paper.models.model import Model, TextNetwork, tokens_over, words

SCHEDULERS = (
    "DDIMScheduler", "DDPMScheduler", "PNDMScheduler", "LMSDiscreteScheduler",
    "EulerDiscreteScheduler", "EulerAncestralDiscreteScheduler", "HeunDiscreteScheduler",
    "DPMSolverMultistepScheduler", "DPMSolverSinglestepScheduler", "DEISMultistepScheduler",
    "KDPM2DiscreteScheduler", "KDPM2AncestralDiscreteScheduler", "UniPCMultistepScheduler",
)  # fmt: skip
"""Schedulers of Stable Diffusion's noise: they differ in how they step, which is `solver` here,
not in how much noise there is at a training step."""
USUAL = {
    "beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear", "steps_offset": 1,
    "set_alpha_to_one": False, "prediction_type": "epsilon",
}  # fmt: skip
"""Stable Diffusion's own settings, where a file does not give them."""
PREDICTIONS: dict[str, Prediction] = {"epsilon": "eps", "v_prediction": "v"}
"""By their names in diffusers' configs."""


class Noise(NamedTuple):
    """How much noise there is, what is predicted of it, and where sampling stops between."""

    schedule: Schedule
    predicts: Prediction
    defaults: SamplerDefaults = SamplerDefaults()
    to_clean: bool = False
    """Whether the last level has no noise (`set_alpha_to_one`)."""


def noise_of(config: Mapping[str, Any], place: Path) -> Noise:
    """The noise of a scheduler's settings, as diffusers computes it.

    Raises InputError, which begins with the place, for a schedule that is not supported.
    """
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler

    name = config.get("_class_name")
    if name not in SCHEDULERS or config.get("use_flow_sigmas"):
        raise InputError(
            f"{place} is a {name}{' of flow matching' * bool(config.get('use_flow_sigmas'))}, "
            f"which gsedit does not run for InstructPix2Pix: one of {', '.join(SCHEDULERS)} works"
        )
    given = USUAL | {key: value for key, value in config.items() if value is not None}
    if given["prediction_type"] not in PREDICTIONS:
        raise InputError(f"{place}: prediction_type is not {' or '.join(PREDICTIONS)}")
    with explained(str(place)):
        scheduler: Any = DDIMScheduler.from_config(given)
        alphas = scheduler.alphas_cumprod.double()
    if not (alphas.diff() < 0).all() or not 0 <= alphas[-1] <= alphas[0] < 1:
        raise InputError(f"{place}: its betas make no noise that grows from 0 to 1: correct them")
    spacing = "trailing" if given.get("timestep_spacing") == "trailing" else None
    if given.get("use_karras_sigmas"):
        spacing = "karras"
    return Noise(
        Schedule(alphas, offset=given["steps_offset"]),
        PREDICTIONS[given["prediction_type"]],
        SamplerDefaults(spacing=spacing) if spacing else SamplerDefaults(),
        bool(given["set_alpha_to_one"]) and spacing is None,
    )


class TextFeatures(NamedTuple):
    """An instruction as the UNet reads it."""

    tokens: Float[Tensor, "l d"]
    pooled: Float[Tensor, " p"] | None = None
    """Pooled vector of the second text encoder (SDXL)."""


class Condition(NamedTuple):
    """The UNet's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode, not scaled."""
    text: TextFeatures
    null: TextFeatures
    """Features of the empty instruction."""
    size: tuple[int, int]
    """(height, width) of the pictures in pixels: an input of SDXL."""


@dataclass(frozen=True, eq=False)
class TextEncoder:
    """A text encoder with its tokenizer."""

    network: TextNetwork
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
    predicts: Prediction = "eps"
    zeros_for_empty: bool = True
    """SDXL: the features of the empty instruction are zeros, not the encoders' output."""
    defaults: SamplerDefaults = field(default_factory=SamplerDefaults)
    to_clean: bool = False
    """Whether the last level has no noise, see `Noise`."""

    @property
    def capabilities(self) -> Capabilities:
        """Every model's, with the scheduler's levels and defaults."""
        levels = self._levels_to_clean if self.to_clean else None
        return replace(super().capabilities, levels=levels, defaults=self.defaults)

    def _levels_to_clean(self, asked: SamplerSettings, _: tuple[int, int]) -> list[NoiseLevel]:
        return self.schedule.levels(asked.step_count, asked.strength, asked.step_spacing)

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
    def text_networks(self) -> tuple[TextNetwork, ...]:
        return tuple(encoder.network for encoder in self.text_encoders)

    def excess(self, prompt: str) -> int:
        return max(encoder.excess(prompt) for encoder in self.text_encoders)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        text, null = self.read_once(self._embed, prompt, "")
        if text.pooled is not None and self.zeros_for_empty:
            null = TextFeatures(torch.zeros_like(text.tokens), torch.zeros_like(text.pooled))
        height, width = originals.shape[1:3]
        return Condition(self.mode(originals), text, null, (height, width))

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


def load(parts: Parts) -> Pix2Pix:
    """The model of a folder. Raises InputError for a schedule or latents that are not supported."""
    unet, vae = parts.network("unet"), parts.network("vae")
    if getattr(vae.config, "latents_mean", None) is not None:
        raise InputError(f"{parts.folder / 'vae'}: latents with a mean are not supported")
    if unet.config.in_channels != 2 * vae.config.latent_channels:
        raise InputError(
            f"{parts.folder}: this is not an InstructPix2Pix model (its unet takes "
            f"{unet.config.in_channels} channels, not {2 * vae.config.latent_channels}): one of "
            f"that kind is {parts.family.example}"
        )
    noise = noise_of(parts.settings("scheduler"), parts.folder / "scheduler")
    is_xl = parts.family == SDXL
    return Pix2Pix(
        unet=unet,
        vae=vae,
        text_encoders=tuple(
            TextEncoder(
                TextNetwork(partial(parts.network, f"text_encoder{end}")),
                parts.tokenizer(f"tokenizer{end}"),
            )
            for end in ("", "_2")[: 1 + is_xl]
        ),
        schedule=noise.schedule,
        predicts=noise.predicts,
        # 5 is the default of diffusers' pipeline of SDXL
        defaults=noise.defaults._replace(guidance_text=5.0) if is_xl else noise.defaults,
        to_clean=noise.to_clean,
        zeros_for_empty=parts.index.get("force_zeros_for_empty_prompt", True),
    )
