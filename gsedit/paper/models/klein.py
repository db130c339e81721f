"""FLUX.2-klein (Black Forest Labs 2026): a transformer that reads the unedited picture as tokens.

`v` views, `b` views at once, `c y x` latents; a token holds 2 by 2 cells: `n` tokens of a picture,
`d = 4 c` numbers each; `l` text tokens of `e` numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pixel_shuffle, pixel_unshuffle

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.guidance import Latents, Need, Prediction
from gsedit.paper.diffusion.schedules import CLEAN, NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.editors.protocol import Capabilities
from gsedit.paper.models.loading import Parts, explained
from gsedit.paper.models.model import Model, TextNetwork, tokens_over, words

LAYERS = (9, 18, 27)
"""Layers of the text encoder whose outputs are the instruction's features."""
DISTILLED = SamplerDefaults(guidance_text=1.0, guidance_image=1.0, steps=4, solver="euler")
"""t_end is Stable Diffusion's, a guess here: 3 of the 4 steps are above it."""
GUIDED = SamplerDefaults(guidance_text=4.0, guidance_image=1.0, steps=50, solver="euler")
"""Weight and steps of diffusers' pipeline."""


class Condition(NamedTuple):
    """The transformer's input that no step changes."""

    images: Float[Tensor, "v n d"]
    """Tokens of the unedited pictures."""
    text: Float[Tensor, "1 l e"]
    null: Float[Tensor, "1 l e"] | None
    """Features of the empty instruction; None for models without guidance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Klein(Model):
    """FLUX.2-klein, of any size, distilled or not."""

    transformer: Any
    text_encoder: TextNetwork
    tokenizer: Any
    scheduler: Any
    """A FlowMatchEulerDiscreteScheduler of diffusers."""
    distilled: bool = True
    """Without guidance: the branch of the instruction is all there is."""
    length: int = 512
    """Tokens of an instruction, with those of the chat around it."""
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Every model's, with levels by size."""
        return replace(
            super().capabilities,
            levels=self._levels,
            defaults=DISTILLED if self.distilled else GUIDED,
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
    def text_networks(self) -> tuple[TextNetwork, ...]:
        return (self.text_encoder,)

    def excess(self, prompt: str) -> int:
        return tokens_over(self.tokenizer, self._chat(prompt), self.length)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """The posterior's mode, normalised by the statistics of each place in a token."""
        tokens = pixel_unshuffle(self.mode(images), 2)
        mean, deviation = self._statistics
        return pixel_shuffle((tokens - mean) / deviation, 2)

    @torch.no_grad()
    def decode(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        mean, deviation = self._statistics
        tokens = pixel_unshuffle(latents, 2) * deviation + mean
        return self.pictures(pixel_shuffle(tokens, 2))

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        reference = packed(self.encode(originals)).to(self.transformer.dtype)
        text, *null = self.read_once(self._embed, prompt, *([] if self.distilled else [""]))
        return Condition(reference, text, null[0] if null else None)

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """A pass for each of (text, picture), (null, picture), (null, no picture) in need."""
        text, null, reference = condition.text, condition.null, condition.images
        if null is None and (need.image or need.none):
            raise UsageError(f"{self.name} is distilled, it has no guidance: leave guidance at 1")
        branches = [(text, reference), (null, reference), (null, reference[:, :0])]
        return tuple(
            self._velocity(x, t, *branch) for branch, needed in zip(branches, need) if needed
        )

    def _velocity(
        self,
        x: Float[Tensor, "b c y x"],
        t: float,
        text: Float[Tensor, "1 l e"],
        reference: Float[Tensor, "b m d"],
    ) -> Float[Tensor, "b c y x"]:
        dtype, views = self.transformer.dtype, len(x)
        out = self.run(
            _with_reference,
            self.transformer,
            packed(x).to(dtype),
            reference,
            torch.full((views,), t, dtype=torch.float32).to(dtype) / 1000,  # as the pipeline rounds
            text.to(dtype).expand(views, -1, -1),
            # on the first axis, the unedited picture is at 10 and the noised one at 0
            torch.cat((_places(0, x), _places(10, x)[: reference.shape[1]])),
        )
        return unpacked(out.to(x.dtype), x.shape[2] // 2, x.shape[3] // 2)

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        """A line of shares of noise s that falls from `strength`, as diffusers' scheduler bends it:
        more so the larger the picture (Esser et al. 2024, section 5.3)."""
        from diffusers.pipelines.flux2.pipeline_flux2_klein import compute_empirical_mu

        if settings.step_spacing != SamplerDefaults().spacing:
            raise UsageError(
                f"spacing {settings.step_spacing} is not for this model, which divides its noise "
                "levels in its own way: leave it out"
            )
        steps = settings.step_count
        mu = compute_empirical_mu((cells[0] // 2) * (cells[1] // 2), steps)
        line = [settings.strength * (1 - i / steps) for i in range(steps)]
        self.scheduler.set_timesteps(sigmas=line, mu=mu)
        shares = self.scheduler.sigmas[:-1].tolist()
        train_steps = len(self.schedule.alphas_cumprod) - 1
        return [*(NoiseLevel(train_steps * s, 1 - s, s) for s in shares), CLEAN]

    @property
    def _statistics(self) -> tuple[Float[Tensor, "1 d 1 1"], Float[Tensor, "1 d 1 1"]]:
        """(mean, standard deviation) of each number of a token."""
        of = self.vae.bn
        mean, variance = (
            each.float()[None, :, None, None] for each in (of.running_mean, of.running_var)
        )
        return mean, (variance + self.vae.config.batch_norm_eps).sqrt()

    def _chat(self, text: str) -> str:
        """The instruction as a question to the language model that encodes it."""
        return self.tokenizer.apply_chat_template(
            [{"role": "user", "content": text}],
            tokenize=False,
            add_generation_prompt=True,
            enable_thinking=False,
        )

    def _embed(self, text: str) -> Float[Tensor, "1 l e"]:
        ids, mask = words(self.tokenizer, self._chat(text), self.length)
        out = self.text_encoder(
            ids, attention_mask=mask, use_cache=False, output_hidden_states=True
        )
        return torch.cat([out.hidden_states[layer] for layer in LAYERS], -1)


def load(parts: Parts) -> Klein:
    """The model of a folder. Raises InputError for a schedule that is not supported."""
    scheduler = scheduler_of(parts.settings("scheduler"), parts.folder / "scheduler")
    return Klein(
        transformer=parts.network("transformer"),
        vae=parts.network("vae"),
        text_encoder=TextNetwork(lambda: _used(parts.network("text_encoder"))),
        tokenizer=parts.tokenizer("tokenizer"),
        scheduler=scheduler,
        schedule=Schedule.rectified_flow(scheduler.config.num_train_timesteps),
        distilled=bool(parts.index.get("is_distilled", False)),
    )


def scheduler_of(config: dict[str, Any], place: Path) -> Any:
    """The scheduler of a scheduler_config.json; `place` is named in errors. Raises InputError."""
    from diffusers.schedulers.scheduling_flow_match_euler_discrete import (
        FlowMatchEulerDiscreteScheduler,
    )

    name = config.get("_class_name")
    if name != FlowMatchEulerDiscreteScheduler.__name__:
        raise InputError(
            f"{place}: the scheduler is {name}, this model needs FlowMatchEulerDiscreteScheduler"
        )
    for option in ("invert_sigmas", "stochastic_sampling"):
        if config.get(option):
            raise InputError(f"{place}: {option} is not supported, it must be false")
    with explained(str(place)):
        scheduler: Any = FlowMatchEulerDiscreteScheduler.from_config(config)
        scheduler.set_timesteps(2, mu=1.0)
    return scheduler


def _used(language_model: Any) -> Any:
    """The part that is looked at: without the last layers, and what predicts the next word."""
    del language_model.model.layers[LAYERS[-1] + 1 :]
    return language_model.model


def packed(latents: Latents) -> Float[Tensor, "v n d"]:
    """Tokens row by row; of a token the channels come first, then the rows and columns in it."""
    return pixel_unshuffle(latents, 2).flatten(2).transpose(1, 2)


def unpacked(tokens: Float[Tensor, "v n d"], rows: int, columns: int) -> Latents:
    """Latents of `rows` by `columns` tokens: the inverse of `packed`."""
    return pixel_shuffle(tokens.transpose(1, 2).unflatten(2, (rows, columns)), 2)


def _places(picture: int, latents: Latents) -> Int[Tensor, "n 4"]:
    """Positions of a picture's tokens: (picture, row, column, 0)."""
    rows, columns = (torch.arange(side // 2) for side in latents.shape[2:])
    one = torch.tensor([0])
    return torch.cartesian_prod(one + picture, rows, columns, one)


def _with_reference(
    transformer: Any, tokens: Tensor, reference: Tensor, time: Tensor, text: Tensor, places: Tensor
) -> Tensor:
    """The flow at the noised picture's tokens, which come before the unedited picture's."""
    return transformer(
        hidden_states=torch.cat((tokens, reference), 1),
        timestep=time,
        encoder_hidden_states=text,
        txt_ids=torch.nn.functional.pad(torch.arange(text.shape[1])[:, None], (3, 0)),
        img_ids=places,
    ).sample[:, : tokens.shape[1]]
