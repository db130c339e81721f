"""A small decoder in place of a model's own: TAESD's architecture, diffusers' AutoencoderTiny."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from gsedit.errors import InputError, UsageError
from gsedit.models.headers import tensors
from gsedit.models.layout import CONFIGS, STEMS
from gsedit.models.model import Model
from gsedit.models.parts import explained
from gsedit.models.weights import config_of

KIND = "AutoencoderTiny"
M = TypeVar("M", bound=Model)


def with_small_decoder(model: M, folder: str | Path) -> M:
    """The model with the decoder of a folder (config.json and its weights as safetensors).

    Pictures are still encoded by the model's own autoencoder. Whether the decoder was made for
    these latents, no file says: those of SD 1.5 and SDXL have the same shape. Raises InputError for
    a folder that holds none, UsageError for one that does not fit the model.
    """
    from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny

    folder = Path(folder).expanduser()
    config = config_of(folder / CONFIGS["network"])
    _check(model, config, folder)
    tensors(folder / f"{STEMS['network']}.safetensors")
    kind: Any = AutoencoderTiny
    with explained(str(folder)):
        decoder, found = kind.from_pretrained(
            str(folder), local_files_only=True, use_safetensors=True, output_loading_info=True
        )
    if missing := found["missing_keys"]:
        raise InputError(f"{folder} lacks {sorted(missing)[0]}: download it again")
    return replace(model, decoder=decoder.eval().requires_grad_(False))


def _check(model: Model, config: dict[str, Any], folder: Path) -> None:
    """Raise InputError for another class, UsageError for latents that the model does not have."""
    if config.get("_class_name") != KIND:
        raise InputError(
            f"{folder} is a {config.get('_class_name', 'network without a class')}, not an {KIND}: "
            "give a folder such as madebyollin/taesd's (SD 1.5) or taesdxl's"
        )
    if not model.takes_small_decoder:
        raise UsageError(
            f"--decoder does not fit a {type(model).__name__} model, which gsedit decodes by its "
            "own autoencoder alone: leave it out"
        )
    channels = config.get("latent_channels", 4)
    cell = 2 ** (len(config.get("decoder_block_out_channels", (64, 64, 64, 64))) - 1)
    if (channels, cell) != (model.channels, model.cell):
        raise UsageError(
            f"{folder} decodes latents of {channels} channels on cells of {cell} pixels, the model "
            f"has {model.channels} and {model.cell}: take the decoder of its family"
        )
