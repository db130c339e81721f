"""InstructPix2Pix models of diffusers that are tiny and random."""

from __future__ import annotations

import json
from pathlib import Path

import diffusers
import torch
import transformers

PROMPT = "make it snow"
SD = {
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "clip_sample": False,
    "set_alpha_to_one": False,
    "steps_offset": 1,
}
UNET = {
    "block_out_channels": (32, 64),
    "layers_per_block": 2,
    "sample_size": 32,
    "in_channels": 8,
    "out_channels": 4,
    "down_block_types": ("DownBlock2D", "CrossAttnDownBlock2D"),
    "up_block_types": ("CrossAttnUpBlock2D", "UpBlock2D"),
}


def tiny_unet() -> diffusers.UNet2DConditionModel:
    return diffusers.UNet2DConditionModel(**UNET, cross_attention_dim=32)


def tiny_xl_unet() -> diffusers.UNet2DConditionModel:
    """As SDXL's: its conditions are six numbers (8 features each) and a pooled text of 32."""
    return diffusers.UNet2DConditionModel(
        **UNET,
        attention_head_dim=(2, 4),
        use_linear_projection=True,
        addition_embed_type="text_time",
        addition_time_embed_dim=8,
        transformer_layers_per_block=(1, 2),
        projection_class_embeddings_input_dim=8 * 6 + 32,
        cross_attention_dim=64,
    )


def tiny_text() -> transformers.CLIPTextConfig:
    return transformers.CLIPTextConfig(
        bos_token_id=53,
        eos_token_id=54,
        pad_token_id=54,
        hidden_size=32,
        intermediate_size=37,
        num_attention_heads=4,
        num_hidden_layers=2,
        vocab_size=55,
        projection_dim=32,
    )


def tiny_vae() -> diffusers.AutoencoderKL:
    return diffusers.AutoencoderKL(
        block_out_channels=(32, 64),
        in_channels=3,
        out_channels=3,
        down_block_types=("DownEncoderBlock2D",) * 2,
        up_block_types=("UpDecoderBlock2D",) * 2,
        latent_channels=4,
    )


def tiny_tokenizer(folder: Path) -> transformers.CLIPTokenizer:
    """Bytes of a few letters, one merge, and the two special tokens."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    ends = [f"{letter}</w>" for letter in letters]
    words = [*letters, *ends, "it</w>", "<|startoftext|>", "<|endoftext|>"]
    folder.mkdir()
    vocabulary = {word: index for index, word in enumerate(words)}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\ni t</w>\n")
    return transformers.CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77
    )


def tiny_pipeline(words: Path) -> diffusers.StableDiffusionInstructPix2PixPipeline:
    with torch.random.fork_rng():
        torch.manual_seed(0)  # the modules offer no generator for their initial weights
        text = transformers.CLIPTextModel(tiny_text())
        pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
            unet=tiny_unet().eval(),
            vae=tiny_vae().eval(),
            text_encoder=text.eval(),
            tokenizer=tiny_tokenizer(words / "tokenizer"),
            scheduler=diffusers.DDIMScheduler(**SD),
            safety_checker=None,
            feature_extractor=None,
            requires_safety_checker=False,
        )
    pipe.set_progress_bar_config(disable=True)
    return pipe


def tiny_xl_pipeline(words: Path) -> diffusers.StableDiffusionXLInstructPix2PixPipeline:
    with torch.random.fork_rng():
        torch.manual_seed(1)
        pipe = diffusers.StableDiffusionXLInstructPix2PixPipeline(
            unet=tiny_xl_unet().eval(),
            vae=tiny_vae().eval(),
            text_encoder=transformers.CLIPTextModel(tiny_text()).eval(),
            text_encoder_2=transformers.CLIPTextModelWithProjection(tiny_text()).eval(),
            tokenizer=tiny_tokenizer(words / "one"),
            tokenizer_2=tiny_tokenizer(words / "two"),
            scheduler=diffusers.DDIMScheduler(**SD),
            add_watermarker=False,
        )
    pipe.set_progress_bar_config(disable=True)
    return pipe
