"""Networks out of a single-file checkpoint, by diffusers' own conversion of the names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from gsedit.errors import InputError
from gsedit.models.single_file import SingleFile


def network_of(
    file: SingleFile, settings: Path, name: str, kind: Any, dtype: torch.dtype
) -> torch.nn.Module:
    """A network of diffusers (`kind`) with the settings in `settings`/`name`.

    Raises InputError for weights that it lacks, and what diffusers does for others.
    """
    try:
        network = kind.from_single_file(
            str(file.path), config=str(settings), subfolder=name, local_files_only=True,
            torch_dtype=dtype, **file.overrides(name),
        )  # fmt: skip
    except NotImplementedError:  # torch cannot convert weights that no file gave
        raise _lacking(file, settings / name) from None
    return _whole(network, file, settings / name)


def text_encoder_of(
    file: SingleFile, settings: Path, name: str, kind: Any, dtype: torch.dtype
) -> torch.nn.Module:
    """A text encoder of transformers, as `network_of`."""
    from diffusers.loaders.single_file_utils import (
        create_diffusers_clip_model_from_ldm,
        load_single_file_checkpoint,
    )

    held = load_single_file_checkpoint(str(file.path))
    network = create_diffusers_clip_model_from_ldm(
        kind, held, subfolder=name, config=str(settings), torch_dtype=dtype, local_files_only=True
    )
    return _whole(network, file, settings / name)


def _whole(network: Any, file: SingleFile, place: Path) -> torch.nn.Module:
    """The network. Raises InputError where the file lacks some of its weights."""
    if any(each.is_meta for each in network.parameters()):
        raise _lacking(file, place)
    return network


def _lacking(file: SingleFile, place: Path) -> InputError:
    return InputError(
        f"{file.path} lacks weights of the network in {place}/config.json: the two are of different"
        " models, or the file is a part of one; take the settings of the file's own"
    )
