"""The losses of NeRF-Art (Wang et al. 2023) on renders, through CLIP (Radford et al. 2021).

    L = L_dir + 0.2 L_con(whole picture) + 0.1 mean L_con(patch)
    L_dir = 1 - cos(E(I) - E(I_0), E(target) - E(source))
    L_con(I) = -log(exp(E(I).E(target) / tau) / sum_t exp(E(I).E(t) / tau))

I is the render, I_0 the unedited one of the same view, and t runs over target and source. Theirs
keep the content with features of VGG; here the regularizer of Vox-E does. `n` pictures, `m` texts,
`d` channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.formats.pictures import fitted_size
from gsedit.paper.session import Session
from rasterizer.camera import Camera
from research.strategies.descent import Descent

MEAN = (0.48145466, 0.4578275, 0.40821073)
STD = (0.26862954, 0.26130258, 0.27577711)
"""Mean and deviation of RGB in [0, 1] that all of OpenAI's models were trained with."""
TEMPERATURE = 0.07
"""tau of the contrastive loss, as in NeRF-Art."""
WHOLE, LOCAL, PATCHES = 0.2, 0.1, 4
"""Weights of the contrastive losses, and patches of a picture, half as wide as it."""


@dataclass(frozen=True, eq=False)
class Encoders:
    """An image encoder and a text encoder with a common space: transformers.CLIPModel."""

    model: Any
    tokenizer: Any

    @property
    def size(self) -> int:
        """Pixels a side of the pictures that the image encoder reads."""
        return int(self.model.config.vision_config.image_size)

    def images(self, pictures: Float[Tensor, "n h w 3"]) -> Float[Tensor, "n d"]:
        """Unit vectors of pictures in [0, 1], resized without a crop; differentiable."""
        x = pictures.movedim(-1, 1).float()
        x = F.interpolate(x, (self.size, self.size), mode="bicubic", align_corners=False)
        mean, std = (x.new_tensor(s)[:, None, None] for s in (MEAN, STD))
        pooled = self.model.vision_model(pixel_values=(x - mean) / std).pooler_output
        return F.normalize(self.model.visual_projection(pooled), dim=-1)

    @torch.no_grad()
    def texts(self, texts: Sequence[str]) -> Float[Tensor, "m d"]:
        """Unit vectors of texts; what is longer than the model reads is cut off."""
        longest = self.model.config.text_config.max_position_embeddings
        tokens = self.tokenizer(
            list(texts), padding=True, truncation=True, max_length=longest, return_tensors="pt"
        )
        pooled = self.model.text_model(
            input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]
        ).pooler_output
        return F.normalize(self.model.text_projection(pooled), dim=-1)


@lru_cache(maxsize=1)
def load_clip(folder: Path) -> Encoders:
    """The CLIPModel and its tokenizer in a folder of transformers; nothing is downloaded."""
    import transformers

    model: Any = transformers.CLIPModel.from_pretrained(
        folder, local_files_only=True, use_safetensors=True
    )
    tokenizer = transformers.CLIPTokenizer.from_pretrained(folder, local_files_only=True)
    return Encoders(model.eval().float().requires_grad_(False), tokenizer)


@dataclass(frozen=True)
class Clip(Descent):
    """Descend NeRF-Art's losses; no 2D editor is asked, so any instruction will do."""

    asks_editor: ClassVar[bool] = False

    folder: Path = Path("clip")
    """A CLIPModel of transformers, such as a copy of openai/clip-vit-base-patch32."""
    source: str = "a photo"
    """A caption of the unedited scene; that of the edited one is the instruction."""

    def camera(self, session: Session, view: int) -> Camera:
        """The view's camera at up to twice CLIP's size: patches are half as wide as a picture."""
        camera, size = session.request.every_view[view].camera, 2 * load_clip(self.folder).size
        return camera.resized(*fitted_size(camera.width, camera.height, size))

    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """The sum of the losses, beside the unedited scene at the same view."""
        clip, request = load_clip(self.folder), session.request
        before = clip.images(session.unedited.picture(view)[None])[0].detach()
        target, source = clip.texts([request.prompt, self.source])
        image = image.clamp(0, 1)
        cuts = torch.stack([_patch(image, request.generator) for _ in range(PATCHES)])
        whole, parts = clip.images(image[None]), clip.images(cuts)
        towards = F.cosine_similarity(whole[0] - before, target - source, dim=0)
        loss = 1 - towards + WHOLE * contrast(whole, target, source)
        loss = loss + LOCAL * contrast(parts, target, source)
        return loss, float(loss.detach())


def contrast(
    vectors: Float[Tensor, "n d"], target: Float[Tensor, " d"], source: Float[Tensor, " d"]
) -> Float[Tensor, ""]:
    """Mean InfoNCE of the target against the source, 0 or more."""
    logits = vectors @ torch.stack((target, source)).mT / TEMPERATURE
    return F.cross_entropy(logits, torch.zeros(len(vectors), dtype=torch.long))


def _patch(image: Float[Tensor, "h w 3"], generator: torch.Generator) -> Float[Tensor, "s s 3"]:
    """A random square inside the picture."""
    side = max(1, min(image.shape[:2]) // 2)
    top, left = (
        int(torch.randint(length - side + 1, (), generator=generator)) for length in image.shape[:2]
    )
    return image[top : top + side, left : left + side]
