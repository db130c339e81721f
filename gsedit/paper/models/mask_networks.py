"""Networks of transformers that find what a phrase names: CLIPSeg; GroundingDINO with SAM.

Only safetensors are read, and no code that comes with a model is run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate

from gsedit.errors import InputError, UsageError
from gsedit.formats.pictures import as_picture
from gsedit.paper.models.hub import cached, settings_in
from gsedit.paper.models.loading import explained, quiet
from gsedit.paper.models.model import tokens_over

BOX_SCORE, TEXT_SCORE = 0.35, 0.25
"""Least scores of a box and of a word in it: those of GroundingDINO's own demonstration."""
EXAMPLES = {
    "clipseg": "CIDAS/clipseg-rd64-refined",
    "grounding-dino": "IDEA-Research/grounding-dino-tiny",
    "sam": "facebook/sam-vit-base",
}
"""A model of each kind on the hub, by `model_type` in its config.json."""


@dataclass(frozen=True, eq=False)
class ClipSeg:
    """A MaskProvider: CLIPSeg (Lueddecke and Ecker 2022), which draws soft masks of words."""

    network: Any
    processor: Any
    name: str = "clipseg"

    def check(self, phrase: str) -> None:
        """Raise UsageError for a phrase that is empty, or longer than the network reads."""
        _check_words(phrase, self.processor.tokenizer, _most_words(self.network.config.text_config))

    @torch.no_grad()
    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield the network's probabilities, stretched to the pictures' sizes."""
        for picture in pictures:
            image = as_picture(picture)
            inputs = self.processor(text=[phrase], images=[image], return_tensors="pt")
            logits = self.network(**inputs).logits
            size = (picture.shape[0], picture.shape[1])
            logits = interpolate(logits.reshape(1, 1, *logits.shape[-2:]), size, mode="bilinear")
            yield logits[0, 0].float().sigmoid()


@dataclass(frozen=True, eq=False)
class GroundedSam:
    """A MaskProvider: GroundingDINO (Liu et al. 2023) finds boxes, SAM (Kirillov et al. 2023) what
    is in them."""

    detector: Any
    detector_processor: Any
    segmenter: Any
    segmenter_processor: Any
    name: str = "grounded-sam"

    def check(self, phrase: str) -> None:
        """Raise UsageError for a phrase that is empty, or longer than the detector reads."""
        most = min(self.detector.config.max_text_len, _most_words(self.detector.config.text_config))
        _check_words(_as_asked(phrase), self.detector_processor.tokenizer, most)

    @torch.no_grad()
    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield where a pixel is probably in any of the boxes' objects; zeros without a box."""
        for picture in pictures:
            boxes = self._boxes(picture, phrase)
            yield self._inside(picture, boxes) if len(boxes) else torch.zeros(picture.shape[:2])

    def _boxes(self, picture: Float[Tensor, "h w 3"], phrase: str) -> Float[Tensor, "b 4"]:
        """Corners of what is found, pixels: left, top, right, bottom."""
        image, text = as_picture(picture), _as_asked(phrase)
        inputs = self.detector_processor(images=image, text=text, return_tensors="pt")
        (found,) = self.detector_processor.post_process_grounded_object_detection(
            self.detector(**inputs), inputs.input_ids, threshold=BOX_SCORE,
            text_threshold=TEXT_SCORE, target_sizes=[(image.height, image.width)],
        )  # fmt: skip
        return found["boxes"].float()

    def _inside(
        self, picture: Float[Tensor, "h w 3"], boxes: Float[Tensor, "b 4"]
    ) -> Float[Tensor, "h w"]:
        inputs = self.segmenter_processor(
            as_picture(picture), input_boxes=[boxes.tolist()], return_tensors="pt"
        )
        sizes = inputs.pop("original_sizes"), inputs.pop("reshaped_input_sizes")
        inputs["input_boxes"] = inputs["input_boxes"].to(inputs["pixel_values"])
        out = self.segmenter(**inputs, multimask_output=False).pred_masks
        processor = self.segmenter_processor.image_processor
        (logits,) = processor.post_process_masks(out, *sizes, binarize=False)
        return logits[:, 0].float().sigmoid().amax(0)


def load_clipseg(folder: str | Path) -> ClipSeg:
    """CLIPSeg of a folder, or of the hub's cache by its id. Raises InputError, UsageError."""
    from transformers import CLIPSegForImageSegmentation

    return ClipSeg(*_loaded(folder, "clipseg", CLIPSegForImageSegmentation))


def load_grounded_sam(detector: str | Path, segmenter: str | Path) -> GroundedSam:
    """GroundingDINO and SAM of two folders, as `load_clipseg`."""
    from transformers import GroundingDinoForObjectDetection, SamModel

    return GroundedSam(
        *_loaded(detector, "grounding-dino", GroundingDinoForObjectDetection),
        *_loaded(segmenter, "sam", SamModel),
    )


def _loaded(place: str | Path, model_type: str, kind: Any) -> tuple[Any, Any]:
    """(network, its processor) of a folder with a model of that type."""
    from transformers import AutoProcessor

    example = EXAMPLES[model_type]
    folder = _folder(place, example)
    found = settings_in(folder / "config.json").get("model_type")
    if found != model_type:
        raise InputError(f"{folder} is a {found}, not a {model_type}, such as {example}")
    options: dict[str, Any] = {"local_files_only": True, "trust_remote_code": False}
    with explained(str(folder)), quiet():
        processor = AutoProcessor.from_pretrained(str(folder), **options)
        network, report = kind.from_pretrained(
            str(folder), local_files_only=True, use_safetensors=True, output_loading_info=True
        )
    if missing := sorted(report["missing_keys"]):
        raise InputError(f"{folder} lacks the weights {missing[0]}: download it again")
    return network.eval().requires_grad_(False), processor


def _folder(place: str | Path, example: str) -> Path:
    """The folder itself, or that of the hub's cache. Raises InputError where neither is there."""
    folder = Path(place).expanduser()
    found = folder if folder.is_dir() else cached(str(place), "config.json")
    if found is None:
        raise InputError(
            f"{place}: there is no such folder, nor is it in the hub's cache: run hf download "
            f"{example} --local-dir FOLDER, and name that"
        )
    return found


def _as_asked(phrase: str) -> str:
    """The phrase as GroundingDINO was trained on: lower case, with a full stop at its end."""
    return f"{phrase.lower().strip(' .')}."


def _most_words(config: Any) -> int:
    return int(config.max_position_embeddings)


def _check_words(phrase: str, tokenizer: Any, most: int) -> None:
    if not phrase.strip(" ."):
        raise UsageError('the phrase is empty: say what to find, e.g. "the chair"')
    if excess := tokens_over(tokenizer, phrase, most):
        raise UsageError(
            f"the phrase is {excess} tokens (word parts) longer than the network reads"
        )
