"""Qwen's vision-language networks, their words and pictures: tiny, random, made on the spot."""

from __future__ import annotations

from typing import Any

import torch
import transformers
from tokenizers import pre_tokenizers
from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

WIDTH = 16  # features of a token
SPECIAL = (
    "<|im_start|>",
    "<|im_end|>",
    "<|vision_start|>",
    "<|vision_end|>",
    "<|image_pad|>",
    "<|video_pad|>",
)
TEXT = {
    "hidden_size": WIDTH,
    "intermediate_size": WIDTH,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "num_key_value_heads": 2,
    "head_dim": 8,
    "rope_scaling": {"mrope_section": [1, 1, 2], "rope_type": "default", "type": "default"},
    "rope_theta": 1e6,
}
VISION = {
    "depth": 2,
    "hidden_size": WIDTH,
    "intermediate_size": WIDTH,
    "num_heads": 2,
    "out_hidden_size": WIDTH,
    "patch_size": 14,
}


def tokenizer() -> transformers.Qwen2Tokenizer:
    """Bytes and the special tokens."""
    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    vocabulary = {letter: index for index, letter in enumerate(letters)}
    words = transformers.Qwen2Tokenizer(vocab=vocabulary, merges=[])
    words.add_special_tokens({"additional_special_tokens": list(SPECIAL)})
    return words


def patches(patch: int = 14) -> Qwen2VLImageProcessorPil:
    """Pictures of few patches, whatever their size."""
    return Qwen2VLImageProcessorPil(
        patch_size=patch, size={"shortest_edge": 56 * 56, "longest_edge": 112 * 112}
    )


def processor(kind: Any, words: Any, pictures: Any) -> Any:
    """A processor of that class without its videos, for which transformers wants torchvision."""

    class Still(kind):
        def check_argument_for_proper_class(self, argument_name: str, argument: Any) -> Any:
            return type(argument)

        def save_pretrained(self, folder: Any, **options: Any) -> None:
            self.image_processor.save_pretrained(folder)

    return Still(image_processor=pictures, tokenizer=words, video_processor=None)


def _numbers(words: Any) -> dict[str, int]:
    names = ("vision_start", "vision_end", "image", "video")
    tokens = ("<|vision_start|>", "<|vision_end|>", "<|image_pad|>", "<|video_pad|>")
    numbers = words.convert_tokens_to_ids(list(tokens))
    return {f"{name}_token_id": number for name, number in zip(names, numbers)}


def qwen3_vl(words: Any) -> transformers.Qwen3VLForConditionalGeneration:
    config = transformers.Qwen3VLConfig(
        text_config={**TEXT, "vocab_size": len(words)},
        vision_config={**VISION, "deepstack_visual_indexes": [0], "num_position_embeddings": 64},
        **_numbers(words),
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return transformers.Qwen3VLForConditionalGeneration(config).eval()
