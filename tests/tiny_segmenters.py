"""Tiny random CLIPSeg, GroundingDINO and SAM of transformers, with their processors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
import transformers
from tiny_models import tiny_tokenizer
from transformers.models.grounding_dino.image_processing_pil_grounding_dino import (
    GroundingDinoImageProcessorPil,
)
from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil
from transformers.models.vit.image_processing_pil_vit import ViTImageProcessorPil

WORDS = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "the", "red", "chair")


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
    pictures = ViTImageProcessorPil(size={"height": 32, "width": 32})
    processor = transformers.CLIPSegProcessor(pictures, tiny_tokenizer(place))
    return seeded(transformers.CLIPSegForImageSegmentation, config), processor


def grounding_dino(place: Path) -> tuple[Any, Any]:
    """GroundingDINO with twelve queries and a vocabulary of few words, and its processor."""
    text = {"model_type": "bert", "vocab_size": len(WORDS), "max_position_embeddings": 64}
    text |= {"hidden_size": 16, "intermediate_size": 16}
    text |= {"num_hidden_layers": 1, "num_attention_heads": 2}
    backbone = transformers.SwinConfig(
        image_size=32, embed_dim=8, depths=[1, 1, 1], num_heads=[1, 2, 2], window_size=4,
        out_features=["stage2", "stage3"],
    )  # fmt: skip
    small = {
        f"{side}_{name}": value
        for side in ("encoder", "decoder")
        for name, value in (("layers", 2), ("attention_heads", 2), ("ffn_dim", 16), ("n_points", 2))
    }
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone, text_config=text, num_queries=12, d_model=32, max_text_len=32,
        num_feature_levels=2, disable_custom_kernels=True, **small,
    )  # fmt: skip
    place.mkdir()
    (place / "vocab.txt").write_text("\n".join(WORDS))
    pictures = GroundingDinoImageProcessorPil(size={"shortest_edge": 32, "longest_edge": 48})
    words = transformers.BertTokenizer(str(place / "vocab.txt"))
    processor = transformers.GroundingDinoProcessor(pictures, words)
    return seeded(transformers.GroundingDinoForObjectDetection, config), processor


def sam() -> tuple[Any, Any]:
    """SAM for pictures of 32 pixels, and its processor."""
    width = {"hidden_size": 16}
    vision = transformers.SamVisionConfig(
        output_channels=16, num_hidden_layers=2, num_attention_heads=2, image_size=32, patch_size=8,
        window_size=2, global_attn_indexes=[1], num_pos_feats=8, mlp_dim=16, **width,
    )  # fmt: skip
    prompts = {"image_size": 32, "patch_size": 8, "mask_input_channels": 4, **width}
    decoder = {"mlp_dim": 16, "num_attention_heads": 2, "iou_head_hidden_dim": 16, **width}
    config = transformers.SamConfig(
        vision_config=vision.to_dict(), prompt_encoder_config=prompts, mask_decoder_config=decoder
    )
    square, quarter = {"height": 32, "width": 32}, {"height": 8, "width": 8}
    pictures = SamImageProcessorPil(
        size={"longest_edge": 32}, pad_size=square, mask_size={"longest_edge": 8},
        mask_pad_size=quarter,
    )  # fmt: skip
    return seeded(transformers.SamModel, config), transformers.SamProcessor(pictures)


def saved(folder: Path, model: tuple[Any, Any]) -> Path:
    """The folder with a network and its processor."""
    for part in model:
        part.save_pretrained(folder)
    return folder
