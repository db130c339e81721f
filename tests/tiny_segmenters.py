"""Tiny random CLIPSeg of transformers, with its processor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
import transformers
from tiny_models import tiny_tokenizer

VIT = getattr(transformers, "ViTImageProcessorPil", transformers.ViTImageProcessor)
"""The processor of pictures that needs no torchvision, by either name."""


def seeded(kind: Any, config: Any) -> Any:
    """A network of random weights, large enough that outputs differ from pixel to pixel."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = kind(config).eval()
        for weight in network.parameters():
            if weight.ndim > 1:
                weight.data += 0.2 * torch.randn_like(weight)
    return network


def clipseg(place: Path) -> tuple[Any, Any]:
    """CLIPSeg and its processor, for pictures of 32 pixels."""
    sizes = {"hidden_size": 32, "intermediate_size": 37, "num_attention_heads": 4}
    ends = {"bos_token_id": 53, "eos_token_id": 54, "pad_token_id": 54}
    config = transformers.CLIPSegConfig(
        text_config={**sizes, **ends, "vocab_size": 55, "num_hidden_layers": 2},
        vision_config={**sizes, "num_hidden_layers": 3, "image_size": 32, "patch_size": 8},
        projection_dim=16,
        extract_layers=[0, 1],
        reduce_dim=16,
        decoder_num_attention_heads=2,
        decoder_intermediate_size=16,
    )
    pictures = VIT(size={"height": 32, "width": 32})
    processor = transformers.CLIPSegProcessor(pictures, tiny_tokenizer(place))
    return seeded(transformers.CLIPSegForImageSegmentation, config), processor


def saved(folder: Path, model: tuple[Any, Any]) -> Path:
    """The folder with a network and its processor."""
    for part in model:
        part.save_pretrained(folder)
    return folder
