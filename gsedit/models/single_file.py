"""Single-file checkpoints: told from their headers, with where their settings and tokenizer are.

They hold weights alone, by the names of Stability AI's code. Settings and tokenizer come from a
folder in diffusers' layout beside the file, or from the hub. Loads no torch.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsedit.errors import InputError
from gsedit.models.families import SD, SDXL, Family
from gsedit.models.headers import Stored, tensors

FIRST_LAYER = "model.diffusion_model.input_blocks.0.0.weight"
"""Name of a U-Net's first convolution in Stability AI's checkpoints."""
PREFIXES = {
    "unet": ("model.diffusion_model.",),
    "vae": ("first_stage_model.", "vae."),
    "text_encoder": ("cond_stage_model.transformer.", "conditioner.embedders.0.transformer."),
    "text_encoder_2": ("conditioner.embedders.1.model.",),
}
"""Beginnings of the names of a component's weights."""
EDM = "edm_vpred.sigma_max"
"""Name by which CosXL's checkpoints are told."""
COSXL_SETTINGS = "stabilityai/stable-diffusion-xl-base-1.0"
"""Model of CosXL's size on the hub, whose settings and tokenizers are CosXL's too."""
COSXL_SCHEDULER = {
    "_class_name": "EDMEulerScheduler", "sigma_min": 0.002, "sigma_max": 120.0, "sigma_data": 1.0,
    "prediction_type": "v_prediction", "sigma_schedule": "exponential",
}  # fmt: skip
SMALL = ("*.json", "*/*.json", "*/*.txt")
"""Patterns of the files of a hub repository that are needed beside a single file."""


@dataclass(frozen=True)
class SingleFile:
    """The weights of an InstructPix2Pix model in one safetensors file."""

    path: Path
    held: dict[str, Stored]
    """Its tensors, by their names."""

    @property
    def family(self) -> Family:
        """SDXL, where it has a second text encoder, otherwise Stable Diffusion."""
        return SDXL if self.of("text_encoder_2") else SD

    @property
    def is_cosxl(self) -> bool:
        """Whether it is CosXL-Edit, whose noise and whose conditions are its own."""
        return EDM in self.held

    @property
    def hub_id(self) -> str:
        """A model on the hub whose settings and tokenizers fit."""
        return COSXL_SETTINGS if self.is_cosxl else self.family.example

    def of(self, component: str) -> list[Stored]:
        """The tensors of a component; none where the file does not hold it."""
        begin = PREFIXES[component]
        return [stored for name, stored in self.held.items() if name.startswith(begin)]

    def overrides(self, component: str) -> dict[str, Any]:
        """Settings of a component that the file knows better than any folder of settings."""
        if component != "unet":
            return {}
        return {"in_channels": self.held[FIRST_LAYER].shape[1], "extract_ema": True}

    def advice(self) -> str:
        """The next move where there is no folder of settings."""
        patterns = " ".join(f"--include '{each}'" for each in SMALL)
        return (
            f"where there is a network, run: hf download {self.hub_id} {patterns} --local-dir "
            f"{self.path.stem}; then bring that folder beside the file"
        )


def read_single_file(path: Path) -> SingleFile:
    """The contents of a checkpoint, by its header. Raises InputError for one of another kind, cut
    short, or no safetensors."""
    found = SingleFile(path, tensors(path))
    first = found.held.get(FIRST_LAYER)
    if first is None:
        raise InputError(
            f"{path} is a single file, and no checkpoint of Stable Diffusion: give a folder in "
            "diffusers' layout, with model_index.json"
        )
    if first.shape[1:2] != (8,):
        raise InputError(
            f"{path} is no InstructPix2Pix model (its unet takes {first.shape[1]} channels, not "
            f"8): one of that kind is {SD.example}"
        )
    for component in found.family.components:
        if component.role in ("network", "encoder") and not found.of(component.name):
            raise InputError(
                f"{path} holds no {component.name}: it is a part of a model; give the whole one, "
                f"such as --model {SD.example}"
            )
    return found


def settings_beside(path: Path) -> Path | None:
    """The folder with a checkpoint's settings: of its name without the suffix, or its own folder;
    None where neither has a U-Net's settings."""
    places = (path.with_suffix(""), path.parent)
    return next((each for each in places if (each / "unet" / "config.json").is_file()), None)


def main_dtype(held: Iterable[Stored]) -> str:
    """The dtype that most bytes have, as safetensors names it; empty for no tensors."""
    bytes_of = Counter[str]()
    for tensor in held:
        bytes_of[tensor.dtype] += tensor.size
    return max(bytes_of, key=lambda dtype: bytes_of[dtype], default="")
