"""Qwen's vision-language networks as text encoders that see the picture: features per view.

`v` views of `h w` pixels, `l d` text tokens (those of the picture among them) and features.

A picture becomes the network's patches here and not in transformers' processors, which need
torchvision for the videos that nobody edits. The kinds of tokens are always given: without them
the network takes a picture's tokens for a line of text.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsedit.formats.pictures import as_picture
from gsedit.models.tokens import tokens_over

if TYPE_CHECKING:
    from gsedit.models.parts import Parts

SYSTEM = (
    "Describe the key features of the input image (color, shape, size, texture, objects, "
    "background), then explain how the user's text instruction should alter or modify the image. "
    "Generate a new image that meets the user's requirements while maintaining consistency with "
    "the original input where appropriate."
)
SYSTEM_TOKENS = 64
"""Tokens before the user's words: the same in every request, and no part of the features."""
PICTURE = "<|image_pad|>"


@dataclass(frozen=True, eq=False)
class Reader:
    """A vision-language network that reads an instruction beside the picture it is about."""

    network: Any
    tokenizer: Any
    patches: Any
    """Image processor of transformers: a picture to normalised patches, and their grid."""
    most: int = 1024
    """Tokens that an instruction may have."""

    def excess(self, text: str) -> int:
        """How many tokens of the instruction are too many."""
        return tokens_over(self.tokenizer, text, self.most)

    def features(
        self, images: Float[Tensor, "v h w 3"], text: str, size: tuple[int, int], at_once: int
    ) -> Float[Tensor, "v l d"]:
        """Features of the text beside each picture, shown at `size` (height, width); float32."""
        pictures = [_picture(image, size) for image in images]
        parts = [pictures[i : i + at_once] for i in range(0, len(pictures), at_once)]
        return torch.cat([self._features(part, text) for part in parts])

    def _features(self, pictures: list[Image.Image], text: str) -> Float[Tensor, "b l d"]:
        """Features of pictures of one size: as many tokens each, so that none need be filled up."""
        seen = self.patches(images=pictures, return_tensors="pt")
        ids = self._ids(int(seen.image_grid_thw[0].prod()), text).expand(len(pictures), -1)
        pad = self.tokenizer.convert_tokens_to_ids(PICTURE)
        output = self.network.model(  # without the head, which would guess the next words
            input_ids=ids,
            attention_mask=torch.ones_like(ids),
            pixel_values=seen.pixel_values.to(self.network.dtype),
            image_grid_thw=seen.image_grid_thw,
            mm_token_type_ids=(ids == pad).int(),
            use_cache=False,
        )
        return output.last_hidden_state[:, SYSTEM_TOKENS:].float()

    def _ids(self, patches: int, text: str) -> Tensor:
        """Token numbers of the request, with as many places as the picture has merged patches."""
        places = PICTURE * (patches // self.patches.merge_size**2)
        request = (
            f"<|im_start|>system\n{SYSTEM}<|im_end|>\n<|im_start|>user\n"
            f"<|vision_start|>{places}<|vision_end|>{text}<|im_end|>\n"
            "<|im_start|>assistant\n"
        )
        return self.tokenizer(request, return_tensors="pt").input_ids


def _picture(image: Float[Tensor, "h w 3"], size: tuple[int, int]) -> Image.Image:
    """An 8-bit picture of that (height, width), filtered as diffusers does."""
    picture = as_picture(image)
    height, width = size
    if picture.size == (width, height):
        return picture
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def load_reader(parts: Parts, kind: Any, *, most: int) -> Reader:
    """The text encoder of a folder, a class of transformers. Raises InputError."""
    from transformers import AutoTokenizer
    from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

    return Reader(
        parts.text_encoder("text_encoder", kind).network,
        parts.tokenizer("tokenizer", AutoTokenizer),
        parts.tokenizer("processor", Qwen2VLImageProcessorPil),
        most,
    )
