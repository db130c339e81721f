"""DreamLite pipelines of diffusers that are tiny and random."""

from __future__ import annotations

from typing import Any

import diffusers
import torch
import transformers
from tiny_qwen import WIDTH, patches, processor, qwen3_vl, tokenizer

SCHEDULER = {"use_dynamic_shifting": True, "base_shift": 0.5, "max_shift": 1.16}


def tiny_dreamlite(kind: Any = diffusers.DreamLitePipeline) -> Any:
    """The latents of the VAE are scaled and shifted, which those of the real one are not."""
    words = tokenizer()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        unet = diffusers.DreamLiteUNetModel(
            sample_size=8,
            down_block_types=(
                "DreamLiteCrossAttnNoSelfAttnDownBlock2D",
                "DreamLiteCrossAttnDownBlock2D",
            ),
            up_block_types=("DreamLiteCrossAttnUpBlock2D", "DreamLiteUpBlock2D"),
            block_out_channels=(32, 64),
            cross_attention_dim=WIDTH,
            attention_head_dim=8,
            layers_per_block=1,
            norm_num_groups=8,
            addition_embed_type="time",
            addition_time_embed_dim=8,
            projection_class_embeddings_input_dim=16,
        )
        vae = diffusers.AutoencoderTiny(
            encoder_block_out_channels=(32, 32),
            decoder_block_out_channels=(32, 32),
            num_encoder_blocks=(1, 1),
            num_decoder_blocks=(1, 1),
            scaling_factor=0.7,
            shift_factor=0.1,
        )
    pipe = kind(
        text_encoder=qwen3_vl(words),
        tokenizer=words,
        processor=processor(transformers.Qwen3VLProcessor, words, patches()),
        vae=vae.eval(),
        unet=unet.eval(),
        scheduler=diffusers.FlowMatchEulerDiscreteScheduler(**SCHEDULER),
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe
