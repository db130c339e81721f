"""FLUX.2-klein (Black Forest Labs 2026): a transformer that reads the unedited picture as tokens.

With KV, the picture's tokens attend to themselves alone, and their keys and values are computed
once. `v` views, `b` views at once, `n` tokens of a picture, `d` numbers each; `l` text tokens of
`e` numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pixel_shuffle, pixel_unshuffle

from gsedit.diffusion.flow import FlowScheduler, check_spacing, empirical_mu
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
"""Tokens of an instruction, with those of the chat around it."""
LAYERS = (9, 18, 27)
"""Layers of the text encoder whose outputs are the instruction's features."""
REFERENCE = 10
"""Position of the unedited picture on the first axis, where the noised one is at 0."""
DISTILLED = SamplerDefaults(guidance_text=1.0, guidance_image=1.0, steps=4, solver="euler")
"""t_end is Stable Diffusion's, a guess here: 3 of the 4 steps are above it."""
GUIDED = SamplerDefaults(guidance_text=4.0, guidance_image=1.0, steps=50, solver="euler")
"""Weight and steps of diffusers' pipeline."""


class Condition(NamedTuple):
    """The transformer's input that no step changes."""

    reference: Float[Tensor, "v ..."]
    """Tokens of the unedited pictures, `n d`; with KV their keys and values in each layer."""
    text: Float[Tensor, "1 l e"]
    null: Float[Tensor, "1 l e"] | None
    """Features of the empty instruction; None for models without guidance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Klein(Model):
    """FLUX.2-klein, of any size, distilled or not, with or without KV."""

    transformer: Any
    text_encoder: Any
    tokenizer: Any
    flow: FlowScheduler
    distilled: bool = True
    """Without guidance: the branch of the instruction is all there is."""
    cached: bool = False
    """KV: the transformer's attention has diffusers' processors for it."""
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Every model's; levels by size; and of a distilled model that guidance is refused."""
        return replace(
            super().capabilities,
            levels=self._levels,
            defaults=DISTILLED if self.distilled else GUIDED,
            with_text_weight=self.unguided if self.distilled else None,
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
        return (self.text_encoder,)

    def excess(self, prompt: str) -> int:
        return tokens_over(self.tokenizer, self._chat(prompt), LENGTH)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Latents:
        """The posterior's mode, normalised by the statistics of each place in a token."""
        tokens = pixel_unshuffle(encoded(self.run, self.vae, images, self.micro_batch), 2)
        mean, deviation = self._statistics
        return pixel_shuffle((tokens - mean) / deviation, 2)

    @torch.no_grad()
    def decode_wholly(self, latents: Latents) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        mean, deviation = self._statistics
        tokens = pixel_unshuffle(latents, 2) * deviation + mean
        return decoded(self.run, self.vae, pixel_shuffle(tokens, 2), self.micro_batch)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        latents = self.encode(originals)
        reference = packed(latents).to(self.transformer.dtype)
        if self.cached:
            place = _places(REFERENCE, latents)
            parts = reference.split(self.micro_batch)
            caches = [self.run(_keys_and_values, self.transformer, part, place) for part in parts]
            reference = torch.cat(caches)
        text, *null = self.read_once(self._embed, prompt, *([] if self.distilled else [""]))
        return Condition(reference, text, null[0] if null else None)

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return condition._replace(reference=condition.reference[views])

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """A pass for each of (text, picture), (null, picture), (null, no picture) in need."""
        text, null, reference = condition.text, condition.null, condition.reference
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
        reference: Float[Tensor, "b ..."],
    ) -> Float[Tensor, "b c y x"]:
        dtype, views = self.transformer.dtype, len(x)
        places = _places(0, x)
        if not self.cached:
            places = torch.cat((places, _places(REFERENCE, x)[: reference.shape[1]]))
        out = self.run(
            _with_cache if self.cached else _with_reference,
            self.transformer,
            packed(x).to(dtype),
            reference,
            network_times(t, views, dtype),
            text.to(dtype).expand(views, -1, -1),
            places,
        )
        return unpacked(out.to(x.dtype), x.shape[2] // 2, x.shape[3] // 2)

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        check_spacing(settings)
        steps = settings.step_count
        mu = empirical_mu((cells[0] // 2) * (cells[1] // 2), steps)
        return self.flow.levels(steps, settings.strength, mu=mu)

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
        ids, mask = words(self.tokenizer, self._chat(text), LENGTH)
        out = self.text_encoder(
            ids, attention_mask=mask, use_cache=False, output_hidden_states=True
        )
        return torch.cat([out.hidden_states[layer] for layer in LAYERS], -1)


def load(parts: Parts, *, micro_batch: int) -> Klein:
    """The model of a folder. Raises InputError for a schedule that is not supported."""
    from diffusers.models.autoencoders.autoencoder_kl_flux2 import AutoencoderKLFlux2
    from diffusers.models.transformers.transformer_flux2 import Flux2Transformer2DModel
    from transformers import AutoTokenizer, Qwen3ForCausalLM

    flow = FlowScheduler.read(parts.scheduler_config(), parts.folder / "scheduler")
    cached = parts.pipeline == "Flux2KleinKVPipeline"
    transformer = parts.network("transformer", Flux2Transformer2DModel)
    if cached:
        set_cache_processors(transformer)
    return Klein(
        transformer=transformer,
        vae=parts.network("vae", AutoencoderKLFlux2),
        text_encoder=parts.text_encoder("text_encoder", Qwen3ForCausalLM, _used),
        tokenizer=parts.tokenizer("tokenizer", AutoTokenizer),
        flow=flow,
        schedule=flow.schedule,
        distilled=cached or bool(parts.pipeline_config().get("is_distilled", False)),
        cached=cached,
        micro_batch=micro_batch,
    )


def _used(language_model: Any) -> Any:
    """The part that is looked at: without the last layers, and what predicts the next word."""
    del language_model.model.layers[LAYERS[-1] + 1 :]
    return language_model.model


def set_cache_processors(transformer: Any) -> None:
    """Give a transformer the attention that can keep the keys and values of a picture."""
    from diffusers.models.transformers.transformer_flux2 import (
        Flux2KVAttnProcessor,
        Flux2KVParallelSelfAttnProcessor,
    )

    for block in transformer.transformer_blocks:
        block.attn.set_processor(Flux2KVAttnProcessor())
    for block in transformer.single_transformer_blocks:
        block.attn.set_processor(Flux2KVParallelSelfAttnProcessor())


def _places(picture: int, latents: Latents) -> Int[Tensor, "n 4"]:
    """Positions of a picture's tokens: (picture, row, column, 0)."""
    rows, columns = (torch.arange(side // 2) for side in latents.shape[2:])
    one = torch.tensor([0])
    return torch.cartesian_prod(one + picture, rows, columns, one)


def _text_places(text: Tensor) -> Int[Tensor, "l 4"]:
    """Positions of the text's tokens: (0, 0, 0, number)."""
    numbers = torch.arange(text.shape[1])
    return torch.nn.functional.pad(numbers[:, None], (3, 0))


def _with_reference(
    transformer: Any, tokens: Tensor, reference: Tensor, time: Tensor, text: Tensor, places: Tensor
) -> Tensor:
    """The flow at the noised picture's tokens, which come before the unedited picture's."""
    return transformer(
        hidden_states=torch.cat((tokens, reference), 1),
        timestep=time,
        encoder_hidden_states=text,
        txt_ids=_text_places(text),
        img_ids=places,
    ).sample[:, : tokens.shape[1]]


def _with_cache(
    transformer: Any, tokens: Tensor, kept: Tensor, time: Tensor, text: Tensor, places: Tensor
) -> Tensor:
    """The flow, with the unedited picture's keys and values in place of its tokens."""
    from diffusers.models.transformers.transformer_flux2 import Flux2KVCache

    cache = Flux2KVCache(
        len(transformer.transformer_blocks), len(transformer.single_transformer_blocks)
    )
    cache.num_ref_tokens = kept.shape[3]
    every = (*cache.double_block_caches, *cache.single_block_caches)
    for layer, pair in zip(every, kept.unbind(1)):
        layer.store(*pair.unbind(1))
    return transformer(
        hidden_states=tokens,
        timestep=time,
        encoder_hidden_states=text,
        txt_ids=_text_places(text),
        img_ids=places,
        kv_cache=cache,
        kv_cache_mode="cached",
    ).sample


def _keys_and_values(
    transformer: Any, reference: Tensor, places: Tensor
) -> Float[Tensor, "b layers 2 n heads h"]:
    """Keys and values of the unedited picture's tokens in each layer.

    They depend on neither the text nor the noised picture, of which one token each is passed.
    """
    views, count = reference.shape[:2]
    one = torch.zeros_like(reference[:, :1])
    text = reference.new_zeros(views, 1, transformer.config.joint_attention_dim)
    cache = transformer(
        hidden_states=torch.cat((reference, one), 1),
        timestep=reference.new_zeros(views),
        encoder_hidden_states=text,
        txt_ids=_text_places(text),
        img_ids=torch.cat((places, places[:1])),
        kv_cache_mode="extract",
        num_ref_tokens=count,
    ).kv_cache
    every = (*cache.double_block_caches, *cache.single_block_caches)
    return torch.stack([torch.stack(layer.get(), 1) for layer in every], 1)
