"""A CLIPModel of transformers that is tiny and random, as a folder."""

from __future__ import annotations

from pathlib import Path

import torch
import transformers
from tiny_models import tiny_tokenizer


def write_tiny_clip(folder: Path) -> Path:
    """Both encoders (16 channels, pictures of 32 pixels) and the tokenizer."""
    sizes = {
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_attention_heads": 2,
        "num_hidden_layers": 2,
        "projection_dim": 8,
    }
    special = {"bos_token_id": 53, "eos_token_id": 54, "pad_token_id": 54, "vocab_size": 55}
    config = transformers.CLIPConfig(
        text_config={**sizes, **special},
        vision_config={**sizes, "image_size": 32, "patch_size": 8},
        projection_dim=8,
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)  # the modules offer no generator for their initial weights
        model = transformers.CLIPModel(config)
        for parameter in model.parameters():  # the initial ones are too small to tell texts apart
            parameter.data += 0.2 * torch.randn(parameter.shape)
    folder.mkdir(parents=True)
    model.save_pretrained(folder)
    tiny_tokenizer(folder / "words").save_pretrained(folder)
    return folder
