"""Search for a model's folder: on this machine, in the hub's cache, on the hub. Loads no torch."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gsedit.errors import InputError, UsageError
from gsedit.models.families import SD, Family
from gsedit.models.layout import INDEX, WORDS, chosen, identify
from gsedit.models.single_file import SMALL, read_single_file, settings_beside
from gsedit.models.weights import NO_PICKLE, PICKLES, config_of, inspect

HUB_ID = re.compile(r"([\w.-]+/[\w.-]+)(?:@([\w./-]+))?")
"""A model's name, and a branch, tag or commit of it."""
DEFAULT = SD.example
"""The authors' own weights on the hub."""

UNET_SETTINGS = "unet/config.json"

UNUSED = ("*.fp16*", "*.non_ema*", "safety_checker/*")
"""Files of a hub repository that are no use where the full weights are taken."""

Consent = bool | Callable[[str], bool]
"""Whether a download is agreed to, or what asks, given a sentence with its size and licence."""


def find(
    model: str,
    weights_dir: str | Path | None = None,
    *,
    offline: bool = False,
    yes: Consent = False,
) -> Path:
    """The folder, or single file, that holds the model, whole or not.

    What the hub's cache holds is taken if it is whole, since the hub can complete it; with
    `offline` the hub is not asked, and what the cache holds is taken as it is. A download has to
    be agreed to. Raises InputError for a model that is nowhere or of another kind, UsageError
    for a download without agreement.
    """
    places = [Path(model).expanduser()]
    if weights_dir is not None:
        places += [Path(weights_dir).expanduser() / name for name in (model, Path(model).name)]
    for place in places:
        if place.exists():
            return place
    looked = " and ".join(str(place) for place in places)
    _check_id(model, looked)
    cached = _cached(model)
    if cached is not None and (offline or _is_complete(cached)):
        return cached
    failed = ""
    if not offline:
        try:
            return _downloaded(model, yes)
        except Unreachable as error:
            failed = f" and could not be downloaded ({error})"
    from huggingface_hub import constants

    raise InputError(
        f"{model} is not on this machine (looked for {looked} and in {constants.HF_HUB_CACHE})"
        f"{failed}; {download_advice(model)}"
    )


def settings_for(place: Path, *, offline: bool = False, yes: Consent = False) -> Path | None:
    """The folder with a single file's settings and tokenizers; None for a folder of a model, and
    where they are beside the file or nowhere.

    What the hub's cache lacks is downloaded, some MB, as `find` does. Raises as `find`.
    """
    if not place.is_file() or place.suffix in PICKLES or settings_beside(place) is not None:
        return None
    file = read_single_file(place)
    cached = _cached(file.hub_id, UNET_SETTINGS)
    if (cached is not None and (cached / UNET_SETTINGS).is_file()) or offline:
        return cached
    _check_id(file.hub_id, str(place))
    offer = f"{place} is a single file: its settings and tokenizer are those of {file.hub_id}, 3 MB"
    if not (yes(offer) if callable(yes) else yes):
        raise UsageError(f"{offer}: add --yes to download them, or {file.advice()}")
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(file.hub_id, allow_patterns=list(SMALL)))
    except Exception as error:  # as in _downloaded
        raise InputError(
            f"{offer}, which could not be downloaded ({_reason(error)}); {file.advice()}"
        ) from error


def _check_id(model: str, looked: str) -> None:
    """Raise InputError for what is no hub id, UsageError without the hub's library."""
    if not HUB_ID.fullmatch(model):
        raise InputError(
            f"{model}: no such model folder (looked for {looked}), and no hub id (like owner/name "
            "or owner/name@revision) either"
        )
    if find_spec("huggingface_hub") is None:
        raise UsageError("a hub id needs huggingface_hub: pip install 'gsedit[diffusers]'")


def _downloaded(model: str, yes: Consent) -> Path:
    """The folder that a download makes. Raises Unreachable; UsageError without agreement."""
    offer = offer_of(model)
    _check_disk(offer)
    agreed = yes(str(offer)) if callable(yes) else yes
    if not agreed:
        raise UsageError(f"{offer}: add --yes to download it, or --model FOLDER with other weights")
    try:
        return offer.fetch()
    except Exception as error:  # network, disk and cache errors have no common base
        raise Unreachable(_reason(error)) from error


class Unreachable(Exception):
    """The hub did not answer, with the reason."""


@dataclass(frozen=True)
class Offer:
    """A download: everything that is known before it begins."""

    model: str
    family: Family
    files: tuple[str, ...]
    size: int
    """Bytes of all files; those that the cache holds already are not fetched again."""
    licence: str

    def __str__(self) -> str:
        return (
            f"{self.model} ({self.family.title}) is not on this machine: "
            f"{self.size / 1e9:,.1f} GB in {len(self.files)} files, licence {self.licence}"
        )

    def fetch(self) -> Path:
        """The folder of the hub's cache, with these files. Raises what the hub's library does."""
        from huggingface_hub import snapshot_download

        patterns = [_exactly(name) for name in self.files]
        return Path(snapshot_download(**_named(self.model), allow_patterns=patterns))


def offer_of(model: str) -> Offer:
    """Everything that would be downloaded, from a list of files and the small JSON files.

    Raises Unreachable, and InputError for a model of another kind or without safetensors.
    """
    from huggingface_hub import HfApi

    try:
        found = HfApi().model_info(**_named(model), files_metadata=True)
    except Exception as error:  # network and permission errors have no common base
        raise Unreachable(_reason(error)) from error
    sizes = {each.rfilename: each.size or 0 for each in found.siblings or ()}
    configs: dict[str, Mapping[str, Any] | None] = {}

    def read(name: str) -> Mapping[str, Any] | None:
        if name not in configs:
            configs[name] = _fetched(model, name) if name in sizes else None
        return configs[name]

    family = identify(model, read).family
    files = _files(model, family, read(INDEX), sizes)
    card = getattr(found, "card_data", None)
    licence = (card and (card.get("license_name") or card.get("license"))) or (
        f"not stated (of {family.example}: {family.licence})"
    )
    size = sum(sizes[name] for name in files)
    return Offer(model, family, files, size, str(licence))


def _files(
    model: str, family: Family, index: Mapping[str, Any] | None, names: Iterable[str]
) -> tuple[str, ...]:
    """The files to fetch, of all names. Raises InputError where a component has no weights."""
    names = tuple(names)
    wanted = [INDEX] if index is not None else []
    for component in family.components:
        files = chosen(component, names)
        if component.role in ("network", "encoder") and not files.weights:
            place = f"{model}/{component.name}"
            if any(n.startswith(f"{component.name}/") and n.endswith(PICKLES) for n in names):
                raise InputError(
                    f"{place} has only pickles: {NO_PICKLE}; choose another model, such as "
                    f"--model {family.example}"
                )
            raise InputError(
                f"{place} has no weights as safetensors: choose another model, such as "
                f"--model {family.example}"
            )
        wanted += [*files.settings, *files.weights]
    return tuple(wanted)


def _fetched(model: str, name: str) -> Mapping[str, Any]:
    """A small JSON file of the hub. Raises Unreachable, and InputError for one that is no JSON."""
    from huggingface_hub import hf_hub_download

    try:
        path = hf_hub_download(**_named(model), filename=name)
    except Exception as error:  # as above
        raise Unreachable(_reason(error)) from error
    return config_of(Path(path))


def _check_disk(offer: Offer) -> None:
    """Raise UsageError where the cache's disk has less room than the download takes."""
    from huggingface_hub import constants

    cache = Path(constants.HF_HUB_CACHE)
    place = next(each for each in (cache, *cache.parents) if each.exists())
    free = shutil.disk_usage(place).free
    if offer.size > free:
        raise UsageError(
            f"{offer}; {free / 1e9:,.1f} GB are free in {cache}: make room, or name a folder on "
            "another disk as HF_HOME"
        )


def _cached(model: str, name: str = INDEX) -> Path | None:
    """The folder of the hub's cache, whole or not; None where there is none."""
    from huggingface_hub import snapshot_download

    try:
        # the pattern: its library refuses a folder that lacks a file of the whole repository
        found = snapshot_download(**_named(model), local_files_only=True, allow_patterns=[name])
        return Path(found)
    except Exception:  # its library has no common base of errors; nothing is there
        return None


def _is_complete(folder: Path) -> bool:
    """Whether a folder of the cache can be loaded; one of another kind cannot be completed."""
    if not (folder / INDEX).exists() and not (folder / "unet").is_dir():
        return False
    return inspect(folder).complete


def _named(model: str) -> dict[str, Any]:
    """The name and the revision of a hub id, as its library's functions take them."""
    name, _, revision = model.partition("@")
    return {"repo_id": name, "revision": revision or None}


def _exactly(name: str) -> str:
    """A pattern that matches only this name."""
    return re.sub(r"([\[\]*?])", r"[\1]", name)


def download_advice(model: str) -> str:
    """How to bring a model of the hub to a machine without a network."""
    name, _, revision = model.partition("@")
    of = f" --revision {revision}" if revision else ""
    names = (INDEX, *(f"*/*{end}" for end in (*WORDS, ".safetensors")))
    patterns = [f"--include '{each}'" for each in names]
    patterns += [f"--exclude '{each}'" for each in UNUSED]
    return (
        f"where there is a network, run: hf download {name}{of} --local-dir FOLDER "
        f"{' '.join(patterns)}; then bring FOLDER here and add --model FOLDER"
    )


def _reason(error: Exception) -> str:
    """The last and most telling line of a network error."""
    name = type(error).__name__
    if "Offline" in name or "LocalEntry" in name:
        return "no network, or HF_HUB_OFFLINE is set"
    if "RepositoryNotFound" in name or "GatedRepo" in name:
        return "the hub knows no such model, or it needs a login (hf auth login)"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return name
