"""Search for a model's folder: on this machine, in the hub's cache, on the hub. Loads no torch."""

from __future__ import annotations

import re
from pathlib import Path

from gsedit.editors.models.weights import DEFECTS, WANTED, inspect
from gsedit.errors import InputError, UsageError

DEFAULT = "timbrooks/instruct-pix2pix"
"""The authors' own weights on the hub."""


def find(model: str, weights_dir: str | Path | None = None, *, offline: bool = False) -> Path:
    """The folder that holds the model, whole or not. Raises InputError.

    What the hub's cache holds is taken if it is whole, since the hub can complete it; with
    `offline` the hub is not asked, and what the cache holds is taken as it is.
    """
    places = [Path(model).expanduser()]
    if weights_dir is not None:
        places += [Path(weights_dir).expanduser() / name for name in (model, Path(model).name)]
    for place in places:
        if place.exists():
            return place
    looked = " and ".join(str(place) for place in places)
    if not re.fullmatch(r"[\w.-]+/[\w.-]+", model):
        raise InputError(
            f"{model}: no such model folder (looked for {looked}), and no hub id (like owner/name) "
            "either"
        )
    try:
        from huggingface_hub import constants
    except ImportError:
        raise UsageError(
            "a hub id needs huggingface_hub: pip install 'gsedit[diffusers]'"
        ) from None
    failed = ""
    for local in (True,) if offline else (True, False):
        try:
            folder = _fetch(model, local)
        except Exception as error:  # network, permission and cache errors have no common base
            failed = "" if local else f" and could not be downloaded ({_reason(error)})"
            continue
        if offline or not local or inspect(folder).complete:
            return folder
    raise InputError(
        f"{model} is not on this machine (looked for {looked} and in {constants.HF_HUB_CACHE})"
        f"{failed}; {download_advice(model)}"
    )


def _fetch(model: str, local: bool) -> Path:
    """The folder of the hub's cache, completed from the hub unless `local`."""
    from huggingface_hub import snapshot_download

    wanted = {"allow_patterns": list(WANTED), "ignore_patterns": list(DEFECTS)}
    return Path(snapshot_download(model, local_files_only=local, **wanted))


def download_advice(model: str) -> str:
    """How to bring a model of the hub to a machine without a network."""
    patterns = [f"--include '{each}'" for each in WANTED]
    patterns += [f"--exclude '{each}'" for each in DEFECTS]
    return (
        "where there is a network, run: "
        f"hf download {model} --local-dir FOLDER {' '.join(patterns)} "
        "(about 4 GB for SD 1.5, 14 GB for SDXL); then bring FOLDER here and add --model FOLDER"
    )


def _reason(error: Exception) -> str:
    """The last and most telling line of a network error."""
    name = type(error).__name__
    if "Offline" in name or "LocalEntry" in name:
        return "no network, or HF_HUB_OFFLINE is set"
    if "RepositoryNotFound" in name:
        return "the hub knows no such model, or it needs a login"
    return name
