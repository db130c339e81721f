"""Tiny random FLUX models in diffusers' own pipelines, with tokenizers made here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import diffusers
import tokenizers
import torch
import transformers

CHAT = (
    "{% for message in messages %}<|im_start|>{{ message.role }} {{ message.content }}"
    "{% endfor %}{% if add_generation_prompt %}<|im_start|>assistant{% endif %}"
)
FLOW = {"use_dynamic_shifting": True, "base_shift": 0.5, "max_shift": 1.15}


def seeded(make: Callable[[], Any], seed: int = 0) -> Any:
    """Something made of random weights, the same each time."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return make()


def word_tokenizer(**options: Any) -> transformers.PreTrainedTokenizerFast:
    """A number for each word; 0 pads and 1 is any other word."""
    names = ["<pad>", "<unk>", "make", "it", "snow", "user", "assistant", "<|im_start|>"]
    vocabulary = {name: index for index, name in enumerate(names)}
    words = tokenizers.Tokenizer(tokenizers.models.WordLevel(vocabulary, unk_token="<unk>"))
    words.pre_tokenizer = tokenizers.pre_tokenizers.WhitespaceSplit()
    return transformers.PreTrainedTokenizerFast(
        tokenizer_object=words, pad_token="<pad>", unk_token="<unk>", **options
    )


def trace(pipe: Any, **arguments: Any) -> list[torch.Tensor]:
    """Latents after every step of a pipeline, as the pipeline holds them."""
    steps = []

    def keep(_pipe: Any, _step: int, _t: Any, tensors: dict[str, Any]) -> dict[str, Any]:
        steps.append(tensors["latents"])
        return tensors

    pipe(**arguments, callback_on_step_end=keep, output_type="latent")
    return steps


def flux_2_transformer() -> diffusers.Flux2Transformer2DModel:
    return diffusers.Flux2Transformer2DModel(
        patch_size=1,
        in_channels=8,
        num_layers=2,
        num_single_layers=2,
        attention_head_dim=16,
        num_attention_heads=2,
        joint_attention_dim=48,
        timestep_guidance_channels=16,
        axes_dims_rope=(4, 4, 4, 4),
        guidance_embeds=False,
    )


def flux_2_vae() -> diffusers.AutoencoderKLFlux2:
    """With statistics that differ from channel to channel, and from 0 and 1."""
    vae = diffusers.AutoencoderKLFlux2(
        down_block_types=("DownEncoderBlock2D",) * 2,
        up_block_types=("UpDecoderBlock2D",) * 2,
        block_out_channels=(4, 8),
        layers_per_block=1,
        latent_channels=2,
        norm_num_groups=1,
    )
    vae.bn.running_mean = torch.linspace(-0.2, 0.3, 8)
    vae.bn.running_var = torch.linspace(0.1, 0.5, 8)
    return vae


def qwen_3() -> transformers.Qwen3ForCausalLM:
    """Deep enough for the layers that are read, and one more than is kept."""
    config = transformers.Qwen3Config(
        intermediate_size=16,
        hidden_size=16,
        num_hidden_layers=29,
        num_attention_heads=2,
        num_key_value_heads=1,
        head_dim=8,
        vocab_size=8,
        max_position_embeddings=512,
    )
    return transformers.Qwen3ForCausalLM(config)


def klein(*, distilled: bool = True) -> Any:
    """FLUX.2-klein; cells of 2 pixels, tokens of 4."""
    parts = {
        "transformer": seeded(flux_2_transformer).eval(),
        "vae": seeded(flux_2_vae).eval(),
        "text_encoder": seeded(qwen_3).eval(),
        "tokenizer": word_tokenizer(chat_template=CHAT),
        "scheduler": diffusers.FlowMatchEulerDiscreteScheduler(**FLOW),
    }
    return quiet(diffusers.Flux2KleinPipeline(**parts, is_distilled=distilled))


def quiet(pipe: Any) -> Any:
    """The pipeline without its progress bar."""
    pipe.set_progress_bar_config(disable=True)
    return pipe
