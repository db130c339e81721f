"""DreamLite (arXiv 2603.28713) and DreamLite-mobile: a U-Net that edits half of a canvas.

The U-Net sees the noised latents beside those of the unedited picture, on one canvas twice as
wide; what it predicts for the left half is the edit's. Both read the instruction beside the
picture. `v` views of `h w` pixels, `b` views at once, `l d` text tokens (those of the picture among
them) and features.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsedit.formats.pictures import as_picture
from gsedit.paper.diffusion.flow import FlowScheduler
from gsedit.paper.diffusion.guidance import Need, Prediction
from gsedit.paper.diffusion.schedules import NoiseLevel
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.models.loading import Parts
from gsedit.paper.models.model import Model, tokens_over
from gsedit.paper.protocol import Capabilities

READ_AT = (512, 512)  # pixels at which the text encoder sees every picture
LONGEST = 200  # tokens of an instruction, as diffusers cuts them where no picture is read
INSTRUCTION = (
    "[Edit]: A diptych with two side-by-side images of the same scene. "
    "Compared to the right side, the left one has {}"
)
DEFAULTS = SamplerDefaults(guidance_text=3.5, guidance_image=1.5, steps=30, solver="euler")
MOBILE_DEFAULTS = SamplerDefaults(
    guidance_text=1.0, guidance_image=1.0, t_end=1.2, steps=4, solver="euler"
)
"""t_end: three steps of four at every size up to 1024 pixels. A guess, since it was measured with
an exact score alone (docs/measurements/sampler.md)."""
SYSTEM = (
    "Describe the key features of the input image (color, shape, size, texture, objects, "
    "background), then explain how the user's text instruction should alter or modify the image. "
    "Generate a new image that meets the user's requirements while maintaining consistency with "
    "the original input where appropriate."
)
PICTURE = "<|image_pad|>"


@dataclass(frozen=True, eq=False)
class Reader:
    """Qwen's vision-language network, which reads an instruction beside the picture it is about.

    A picture becomes the network's patches here and not in transformers' processors, which need
    torchvision for the videos that nobody edits. The kinds of tokens are always given: without them
    the network takes a picture's tokens for a line of text.
    """

    network: Any
    tokenizer: Any
    patches: Any
    """Image processor of transformers: a picture to normalised patches, and their grid."""
    most: int = LONGEST
    """Tokens that an instruction may have."""

    def excess(self, text: str) -> int:
        """How many tokens of the instruction are too many."""
        return tokens_over(self.tokenizer, text, self.most)

    def features(
        self, images: Float[Tensor, "v h w 3"], text: str, at_once: int
    ) -> Float[Tensor, "v l d"]:
        """Features of the text beside each picture, shown at READ_AT; float32."""
        shown = [as_picture(image) for image in images]
        pictures = [each.resize(READ_AT, Image.Resampling.LANCZOS) for each in shown]
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
        # the 64 tokens of the system's words are the same in every request
        return output.last_hidden_state[:, 64:].float()

    def _ids(self, patches: int, text: str) -> Tensor:
        """Token numbers of the request, with as many places as the picture has merged patches."""
        places = PICTURE * (patches // self.patches.merge_size**2)
        request = (
            f"<|im_start|>system\n{SYSTEM}<|im_end|>\n<|im_start|>user\n"
            f"<|vision_start|>{places}<|vision_end|>{text}<|im_end|>\n"
            "<|im_start|>assistant\n"
        )
        return self.tokenizer(request, return_tensors="pt").input_ids


class Condition(NamedTuple):
    """The U-Net's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures, not scaled."""
    text: Float[Tensor, "v l d"]
    null: Float[Tensor, "v k d"] | None
    """Features of the empty instruction beside the same pictures; None for DreamLite-mobile."""
    size: tuple[int, int]
    """(width, height) of the pictures in pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DreamLite(Model):
    """DreamLite; with `distilled` DreamLite-mobile, which has no guidance and few steps."""

    unet: Any
    reader: Reader
    scheduler: FlowScheduler
    distilled: bool
    of_each_view: ClassVar[tuple[str, ...]] = ("images", "text", "null")
    predicts: Prediction = "flow"

    @property
    def capabilities(self) -> Capabilities:
        """Noise levels that depend on the picture's size; no guidance of a distilled model."""
        return replace(
            super().capabilities,
            defaults=MOBILE_DEFAULTS if self.distilled else DEFAULTS,
            levels=self._levels,
            distilled=self.distilled,
        )

    @property
    def cell(self) -> int:
        return 2 ** (len(self.vae.config.encoder_block_out_channels) - 1)

    @property
    def multiple(self) -> int:
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def size(self) -> int:
        return 128 * self.cell  # the sides that it was trained on

    def excess(self, prompt: str) -> int:
        return self.reader.excess(prompt)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Every view's text is read beside its own picture; `generator` is not used."""
        images = self.mode(originals)
        text = self._read(originals, INSTRUCTION.format(prompt))
        null = None if self.distilled else self._read(originals, "")
        height, width = originals.shape[1:3]
        return Condition(images, text, null, (width, height))

    def _read(self, originals: Float[Tensor, "v h w 3"], text: str) -> Float[Tensor, "v l d"]:
        return self.reader.features(originals, text, self.micro_batch)

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One U-Net pass for (text, image), (null, image), (null, zeros), as far as in need."""
        text, null, images = condition.text, condition.null, condition.images
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        texts, shown = zip(*(branch for branch, needed in zip(branches, need) if needed))
        dtype = self.unet.dtype
        targets = torch.cat([x.to(images)] * len(texts))
        canvas = torch.cat((targets, torch.cat(shown)), -1).to(dtype)
        tokens, mask = _filled_up(texts)
        time = torch.full((len(canvas),), t, dtype=torch.float32)
        sizes = torch.tensor(condition.size, dtype=torch.float32).expand(len(canvas), -1)
        out = self.run(_predicted, self.unet, canvas, time, tokens.to(dtype), mask, sizes)
        return out[..., : x.shape[-1]].to(x.dtype).chunk(len(texts))

    def _levels(self, settings: SamplerSettings, cells: tuple[int, int]) -> list[NoiseLevel]:
        """Levels for latents of so many rows and columns: a token is 2 x 2 cells."""
        return self.scheduler.levels_of(settings, cells[0] * cells[1] // 4)


def _filled_up(
    texts: tuple[Float[Tensor, "b _ d"], ...],
) -> tuple[Float[Tensor, "n l d"], Float[Tensor, "n l"]]:
    """(features of all branches filled up with zeros to one length, 1 where there is a token)."""
    length = max(text.shape[1] for text in texts)
    rows = [(F.pad(text, (0, 0, 0, length - text.shape[1])), text.shape[1]) for text in texts]
    masks = [(torch.arange(length) < tokens).float().expand(len(row), -1) for row, tokens in rows]
    return torch.cat([row for row, _ in rows]), torch.cat(masks)


def _predicted(
    unet: Any, canvas: Tensor, time: Tensor, tokens: Tensor, mask: Tensor, sizes: Tensor
) -> Tensor:
    return unet(
        canvas,
        time,
        encoder_hidden_states=tokens,
        encoder_attention_mask=mask,
        added_cond_kwargs={"time_ids": sizes},
    ).sample


def load(parts: Parts, *, micro_batch: int) -> DreamLite:
    """The DreamLite or DreamLite-mobile of a folder. Raises InputError."""
    from transformers import AutoTokenizer
    from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

    scheduler = FlowScheduler.read(parts.settings("scheduler"), parts.folder / "scheduler")
    distilled = parts.index["_class_name"] == "DreamLiteMobilePipeline"
    return DreamLite(
        unet=parts.network("unet"),
        vae=parts.network("vae"),
        reader=Reader(
            parts.network("text_encoder"),
            parts.tokenizer("tokenizer", AutoTokenizer),
            parts.tokenizer("processor", Qwen2VLImageProcessorPil),
        ),
        scheduler=scheduler,
        schedule=scheduler.schedule,
        distilled=distilled,
        micro_batch=micro_batch,
        name="dreamlite-mobile" if distilled else "dreamlite",
    )
