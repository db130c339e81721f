"""A network of transformers that finds what a phrase names: CLIPSeg.

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

EXAMPLE = "CIDAS/clipseg-rd64-refined"
"""A model on the hub."""


@dataclass(frozen=True, eq=False)
class ClipSeg:
    """A MaskProvider: CLIPSeg (Lueddecke and Ecker 2022), which draws soft masks of words."""

    network: Any
    processor: Any
    name: str = "clipseg"

    def check(self, phrase: str) -> None:
        """Raise UsageError for a phrase that is empty, or longer than the network reads."""
        most = int(self.network.config.text_config.max_position_embeddings)
        if not phrase.strip(" ."):
            raise UsageError('the phrase is empty: say what to find, e.g. "the chair"')
        if excess := tokens_over(self.processor.tokenizer, phrase, most):
            raise UsageError(
                f"the phrase is {excess} tokens (word parts) longer than the network reads"
            )

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


def load_clipseg(place: str | Path) -> ClipSeg:
    """CLIPSeg of a folder, or of the hub's cache by its id. Raises InputError, UsageError."""
    from transformers import AutoProcessor, CLIPSegForImageSegmentation

    folder = _folder(place)
    found = settings_in(folder / "config.json").get("model_type")
    if found != "clipseg":
        raise InputError(f"{folder} is a {found}, not a clipseg, such as {EXAMPLE}")
    with explained(str(folder)), quiet():
        processor = AutoProcessor.from_pretrained(
            str(folder), local_files_only=True, trust_remote_code=False
        )
        kind: Any = CLIPSegForImageSegmentation
        network, report = kind.from_pretrained(
            str(folder), local_files_only=True, use_safetensors=True, output_loading_info=True
        )
    if missing := sorted(report["missing_keys"]):
        raise InputError(f"{folder} lacks the weights {missing[0]}: download it again")
    return ClipSeg(network.eval().requires_grad_(False), processor)


def _folder(place: str | Path) -> Path:
    """The folder itself, or that of the hub's cache. Raises InputError where neither is there."""
    folder = Path(place).expanduser()
    found = folder if folder.is_dir() else cached(str(place), "config.json")
    if found is None:
        raise InputError(
            f"{place}: there is no such folder, nor is it in the hub's cache: run hf download "
            f"{EXAMPLE} --local-dir FOLDER, and name that"
        )
    return found
