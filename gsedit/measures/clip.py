"""Similarities of pictures and texts by CLIP (Radford et al. 2021), from weights that are given.

Pictures are prepared as in the metric of InstructPix2Pix and Instruct-NeRF2NeRF: resized to the
model's square (224 pixels for the published ones) by bicubic interpolation without cropping, then
standardised. Vectors have unit length. `n` pictures of `h w` pixels, `m` texts, `d` channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.storage.json_files import object_of, read_json

MEAN = (0.48145466, 0.4578275, 0.40821073)
STD = (0.26862954, 0.26130258, 0.27577711)
"""Mean and deviation of RGB in [0, 1] that all of OpenAI's models were trained with."""
MOVED = 1e-6
"""Least length of a difference of unit vectors that has a direction: less is rounding."""


@dataclass(frozen=True, eq=False)
class Clip:
    """An image encoder and a text encoder with a common space."""

    model: Any
    """transformers.CLIPModel, in evaluation mode, without gradients of its own."""
    tokenizer: Any
    folder: Path
    """Folder that it was read from."""

    @property
    def size(self) -> int:
        """Pixels a side of the pictures that the image encoder reads."""
        return int(self.model.config.vision_config.image_size)

    def images(self, pictures: Float[Tensor, "n h w 3"]) -> Float[Tensor, "n d"]:
        """Unit vectors of pictures in [0, 1]; differentiable in them."""
        x = pictures.movedim(-1, 1).float()
        x = F.interpolate(x, (self.size, self.size), mode="bicubic", align_corners=False)
        mean, std = (x.new_tensor(s)[:, None, None] for s in (MEAN, STD))
        pooled = self.model.vision_model(pixel_values=(x - mean) / std).pooler_output
        return F.normalize(self.model.visual_projection(pooled), dim=-1)

    @torch.no_grad()
    def texts(self, texts: Sequence[str]) -> Float[Tensor, "m d"]:
        """Unit vectors of texts; what is longer than the model reads (77 tokens) is cut off."""
        longest = self.model.config.text_config.max_position_embeddings
        tokens = self.tokenizer(
            list(texts), padding=True, truncation=True, max_length=longest, return_tensors="pt"
        )
        pooled = self.model.text_model(
            input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]
        ).pooler_output
        return F.normalize(self.model.text_projection(pooled), dim=-1)


@lru_cache(maxsize=1)
def load_clip(folder: str | Path) -> Clip:
    """The CLIPModel and its tokenizer in a folder of transformers (config.json, model.safetensors,
    tokenizer files). Nothing is downloaded, and no pickle is read.

    Raises UsageError without transformers, InputError for a folder that holds no such model.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            f"--clip {folder} is no folder: name a folder of transformers with a CLIPModel, such "
            "as a copy of openai/clip-vit-large-patch14"
        )
    try:
        import transformers
    except ImportError as error:
        raise UsageError(
            f"--clip needs transformers ({error.name} is missing): pip install 'gsedit[diffusers]'"
        ) from error
    check_files(folder)
    logging = transformers.logging
    level, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()  # it lists what it loads
    logging.disable_progress_bar()
    try:
        loaded: Any = transformers.CLIPModel.from_pretrained(
            folder, local_files_only=True, use_safetensors=True, output_loading_info=True
        )
        model, info = loaded
        tokenizer = transformers.CLIPTokenizer.from_pretrained(folder, local_files_only=True)
    except Exception as error:  # transformers, safetensors and json raise without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)[:160]
        raise InputError(
            f"{folder} holds no readable CLIPModel ({reason}): copy it again"
        ) from error
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()
    if info["missing_keys"]:
        raise InputError(
            f"{folder}: {len(info['missing_keys'])} tensors of the CLIPModel are missing, among "
            f"them {min(info['missing_keys'])}: copy the weights again"
        )
    return Clip(model.eval().float().requires_grad_(False), tokenizer, folder)


def check_files(folder: Path) -> None:
    """Raise InputError where a file that the model needs is not there, or is another model's."""
    config = folder / "config.json"
    advice = "--clip names the folder of a CLIPModel of transformers, with config.json in it"
    kind = read_json(config, object_of({}), advice=advice).get("model_type")
    if kind != "clip":
        raise InputError(
            f"{config} is of a model of type {kind!r}, not 'clip': name the folder of a CLIPModel "
            "(both encoders), not of one encoder or of a pipeline"
        )
    if not list(folder.glob("*.safetensors")):
        raise InputError(
            f"{folder} has no .safetensors file: weights are read from safetensors alone; save the "
            "model again with save_pretrained"
        )
    if not ((folder / "tokenizer.json").is_file() or (folder / "vocab.json").is_file()):
        raise InputError(
            f"{folder} has no tokenizer (vocab.json and merges.txt): copy it there too"
        )


# ---- measures ------------------------------------------------------------------------------------


def similarity(a: Float[Tensor, "*n d"], b: Float[Tensor, "*n d"]) -> Float[Tensor, "*n"]:
    """Cosines of unit vectors, in [-1, 1]."""
    return (a * b).sum(-1)


def direction(
    edited: Float[Tensor, "n d"],
    unedited: Float[Tensor, "n d"],
    target: Float[Tensor, " d"],
    source: Float[Tensor, " d"],
) -> Float[Tensor, " n"]:
    """Directional similarity (Gal et al. 2022, StyleGAN-NADA, eq. 3), signed, in [-1, 1]: the
    cosine of `edited - unedited` (pictures) and `target - source` (texts).

    0 where the picture or the text did not change. Differentiable in the pictures.
    """
    return _cosine(edited - unedited, (target - source).expand_as(edited))


def direction_consistency(
    edited: Float[Tensor, "n d"], unedited: Float[Tensor, "n d"]
) -> Float[Tensor, " n_minus_1"]:
    """Consistency of adjacent frames (Haque et al. 2023, Instruct-NeRF2NeRF): the cosine of how the
    picture changes from frame i to i + 1 after the edit and before it, in [-1, 1]."""
    return _cosine(edited.diff(dim=0), unedited.diff(dim=0))


def _cosine(a: Float[Tensor, "n d"], b: Float[Tensor, "n d"]) -> Float[Tensor, " n"]:
    """Cosines; 0 where one of the vectors is shorter than MOVED."""
    lengths = a.norm(dim=-1) * b.norm(dim=-1)
    moved = torch.minimum(a.norm(dim=-1), b.norm(dim=-1)) > MOVED
    return torch.where(moved, (a * b).sum(-1) / lengths.clamp_min(MOVED**2), 0.0)
