"""Qwen-Image-Edit pipelines of diffusers that are tiny and random."""

from __future__ import annotations

from typing import Any

import diffusers
import torch
import transformers
from tiny_qwen import WIDTH, patches, processor, qwen2_5_vl, tokenizer

SCHEDULER = {
    "use_dynamic_shifting": True,
    "base_shift": 0.5,
    "max_shift": 0.9,
    "max_image_seq_len": 8192,
    "shift_terminal": 0.02,
}
"""Numbers of Qwen-Image's own file."""


def tiny_qwen_image(kind: Any = diffusers.QwenImageEditPipeline) -> Any:
    words = tokenizer()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        transformer = diffusers.QwenImageTransformer2DModel(
            in_channels=16,
            out_channels=4,
            num_layers=2,
            attention_head_dim=16,
            num_attention_heads=3,
            joint_attention_dim=WIDTH,
            axes_dims_rope=(8, 4, 4),
        )
        vae = diffusers.AutoencoderKLQwenImage(
            base_dim=24,
            z_dim=4,
            dim_mult=[1, 2, 4],
            num_res_blocks=1,
            temperal_downsample=[False, True],
            latents_mean=[0.1, -0.2, 0.3, 0.0],
            latents_std=[1.0, 2.0, 0.5, 0.7],
        )
    pipe = kind(
        scheduler=diffusers.FlowMatchEulerDiscreteScheduler(**SCHEDULER),
        vae=vae.eval(),
        text_encoder=qwen2_5_vl(words),
        tokenizer=words,
        processor=processor(transformers.Qwen2VLProcessor, words, patches()),
        transformer=transformer.eval(),
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe
