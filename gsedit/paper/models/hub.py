"""Models of diffusers on this machine and on the hub: which are edited with, where they lie, and
whether their files are whole. Loads no torch."""

from __future__ import annotations

import fnmatch
import json
import re
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

from gsedit.errors import InputError, UsageError
from gsedit.run.json_files import object_of, read_json

INDEX = "model_index.json"
TEXTS = (".json", ".txt", ".model", ".jinja")
"""Ends of the files of settings and tokenizers."""
USED = (*TEXTS, ".safetensors")
PICKLES = (".bin", ".ckpt", ".pt", ".pth")
NO_PICKLE = "a pickle runs whatever code is in it when it is opened, so gsedit opens none"
AGAIN = "download it again"
HUB_ID = re.compile(r"([\w.-]+/[\w.-]+)(?:@([\w./-]+))?")
"""A model's name, and a branch, tag or commit of it."""
Consent = bool | Callable[[str], bool]
"""Whether a download is agreed to, or what asks, given a sentence with its size and licence."""


@dataclass(frozen=True)
class Family:
    """Models of one architecture, which one module loads."""

    title: str
    module: str
    """The module here whose `load(parts, micro_batch=...)` makes the Model."""
    networks: tuple[str, ...]
    """Components that have weights."""
    others: tuple[str, ...]
    """Tokenizers and the scheduler."""
    example: str
    """A model of the family on the hub, with @revision where it is not in the main one."""
    gigabytes: float
    """Size of that model's files that are used, about, in GB."""


SD = Family(
    "InstructPix2Pix of Stable Diffusion 1.5", "stable_diffusion",
    ("unet", "vae", "text_encoder"), ("tokenizer", "scheduler"), "timbrooks/instruct-pix2pix", 4.3,
)  # fmt: skip
SDXL = Family(
    "InstructPix2Pix of SDXL", "stable_diffusion", (*SD.networks, "text_encoder_2"),
    (*SD.others, "tokenizer_2"), "diffusers/sdxl-instructpix2pix-768", 12.3,
)  # fmt: skip
KLEIN = Family(
    "FLUX.2-klein", "klein", ("transformer", *SD.networks[1:]),
    SD.others, "black-forest-labs/FLUX.2-klein-4B", 16.0,
)  # fmt: skip
PIPELINES = {
    "StableDiffusionInstructPix2PixPipeline": SD,
    "StableDiffusionXLInstructPix2PixPipeline": SDXL,
    "Flux2KleinPipeline": KLEIN,
}
"""Families by the class of their pipeline, which model_index.json names."""
DEFAULT = SD.example


def family_of(index: dict[str, Any], place: str | Path) -> Family:
    """The family of a model, by its model_index.json. Raises InputError, with what works."""
    name = index.get("_class_name")
    if not isinstance(name, str) or name not in PIPELINES:
        raise InputError(
            f"{place} is a {name or 'model without a pipeline class'}, which gsedit does not edit "
            f"with. These work: {', '.join(PIPELINES)}, such as --model {DEFAULT}"
        )
    return PIPELINES[name]


def settings_in(path: Path) -> dict[str, Any]:
    """The settings in a JSON file. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path} is missing: download that file of the model too")
    return read_json(path, object_of({}), advice=AGAIN)


# ---- whether files are whole ---------------------------------------------------------------------


@dataclass(frozen=True)
class Part:
    """A component of a model, as it lies on disk."""

    name: str
    problem: str = ""
    """Problem of the component, with its next move; empty for a complete one."""
    files: tuple[Path, ...] = ()
    """Files of its weights."""
    stored: str = ""
    """The dtype of its largest tensor, as safetensors names it (F32, F16, BF16)."""

    @property
    def size(self) -> int:
        """Bytes of its weights."""
        return sum(file.stat().st_size for file in self.files)

    @property
    def variant(self) -> str | None:
        """`fp16` where only that copy is there."""
        return "fp16" if any(".fp16" in file.name for file in self.files) else None


def inspect(folder: Path) -> tuple[Part, ...]:
    """The components of a model's folder, by names and headers; no tensor is read.

    Raises InputError where it holds no model that is edited with.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the one that holds {INDEX}")
    family = family_of(settings_in(folder / INDEX), folder)
    return tuple(_part(folder / name, family) for name in (*family.networks, *family.others))


def require(parts: Iterable[Part], folder: Path) -> None:
    """Raise InputError with the first problem of these parts of a folder."""
    problems = [part.problem for part in parts if part.problem]
    if problems:
        more = f" (and {len(problems) - 1} more: gsedit doctor {folder} lists them)"
        raise InputError(problems[0] + more * (len(problems) > 1))


def _part(place: Path, family: Family) -> Part:
    if not place.is_dir() or not any(place.iterdir()):
        return Part(place.name, f"{place} is missing: download that folder of the model too")
    if place.name not in family.networks:
        return Part(place.name)
    try:
        settings_in(place / "config.json")
        files = _weights(place)
        stored = {file: stored_in(file) for file in files}
    except InputError as error:
        return Part(place.name, str(error))
    largest = max((each for held in stored.values() for each in held.values()), default=(0, ""))
    return Part(place.name, "", tuple(files), largest[1])


def _weights(place: Path) -> list[Path]:
    """The files of a component's weights, full precision before half. Raises InputError."""
    stem = "model" if place.name.startswith("text_encoder") else "diffusion_pytorch_model"
    for variant in ("", ".fp16"):
        if (single := place / f"{stem}{variant}.safetensors").is_file():
            return [single]
        if (table := place / f"{stem}.safetensors.index{variant}.json").is_file():
            names = sorted({str(each) for each in settings_in(table)["weight_map"].values()})
            if outside := [name for name in names if Path(name).name != name]:
                raise InputError(f"{table} names {outside[0]!r}, no file beside it: {AGAIN}")
            return [place / name for name in names]
    if any(path.suffix in PICKLES for path in place.iterdir()):
        raise InputError(f"{place} has only pickles: {NO_PICKLE}; download {stem}.safetensors")
    raise InputError(f"{place} has no {stem}.safetensors: download it")


def stored_in(file: Path) -> dict[str, tuple[int, str]]:
    """(numbers, dtype) of each tensor of a safetensors file. Raises InputError for one that is
    missing, cut short, or of another kind."""
    from safetensors import safe_open

    if not file.is_file():
        raise InputError(f"{file} is missing: download it")
    try:
        with safe_open(file, framework="np") as held:
            slices = {name: held.get_slice(name) for name in held.keys()}  # noqa: SIM118
            return {
                name: (prod(each.get_shape()), each.get_dtype()) for name, each in slices.items()
            }
    except Exception as error:  # safetensors has its own errors, and those of the system
        raise InputError(f"{file} is no whole safetensors file ({error}): {AGAIN}") from None


# ---- where a model is ----------------------------------------------------------------------------


def find(
    model: str,
    weights_dir: str | Path | None = None,
    *,
    offline: bool = False,
    yes: Consent = False,
) -> Path:
    """The folder that holds the model, whole or not.

    In order: `model` as a path, in `weights_dir`, in the hub's cache if it is whole there, on the
    hub; with `offline` the hub is not asked, and what the cache holds is taken as it is. Raises
    InputError for a model that is nowhere or of another kind, UsageError for a download without
    agreement.
    """
    places = [Path(model).expanduser()]
    if weights_dir is not None:
        places += [Path(weights_dir).expanduser() / name for name in (model, Path(model).name)]
    for place in places:
        if place.exists():
            return place
    looked = " and ".join(map(str, places))
    if not HUB_ID.fullmatch(model):
        raise InputError(
            f"{model}: no such model folder (looked for {looked}), and no hub id (like owner/name "
            "or owner/name@revision) either"
        )
    if find_spec("huggingface_hub") is None:
        raise UsageError("a hub id needs huggingface_hub: pip install 'gsedit[diffusers]'")
    here = cached(model, INDEX)
    if here is not None and (offline or not any(part.problem for part in inspect(here))):
        return here
    try:
        if offline:
            raise ConnectionError("the hub is not asked")
        return _downloaded(model, yes)
    except (InputError, UsageError):
        raise
    except Exception as error:  # network, disk and cache errors have no common base
        raise InputError(
            f"{model} is not on this machine (looked for {looked} and in the hub's cache) and "
            f"could not be downloaded ({_reason(error)}); {download_advice(model)}"
        ) from error


def _downloaded(model: str, yes: Consent) -> Path:
    """The folder that a download makes. Raises UsageError without agreement or room for it,
    InputError for a model of another kind, and what the hub's library raises."""
    from huggingface_hub import HfApi, constants, hf_hub_download, snapshot_download

    named = _named(model)
    info = HfApi().model_info(**named, files_metadata=True)
    sizes = {each.rfilename: each.size or 0 for each in info.siblings or ()}
    if INDEX not in sizes:
        raise InputError(f"{model} has no {INDEX}: it is no model in diffusers' layout")
    family = family_of(
        json.loads(Path(hf_hub_download(**named, filename=INDEX)).read_text()), model
    )
    files = [INDEX, *_wanted(model, family, sizes)]
    size, licence = sum(sizes[name] for name in files), (info.card_data or {}).get("license")
    offer = (
        f"{model} ({family.title}) is not on this machine: {size / 1e9:,.1f} GB in {len(files)} "
        f"files, licence {licence or 'not stated'}"
    )
    cache = Path(constants.HF_HUB_CACHE)
    free = shutil.disk_usage(next(each for each in (cache, *cache.parents) if each.exists())).free
    if size > free:
        raise UsageError(
            f"{offer}; {free / 1e9:,.1f} GB are free in {cache}: make room, or name a folder on "
            "another disk as HF_HOME"
        )
    if not (yes(offer) if callable(yes) else yes):
        raise UsageError(f"{offer}: add --yes to download it, or --model FOLDER with other weights")
    return Path(snapshot_download(**named, allow_patterns=files))


def _wanted(model: str, family: Family, names: Iterable[str]) -> list[str]:
    """The files of a model that are used: one precision, no pickles. Raises InputError where a
    network has none."""
    wanted = []
    for part in (*family.networks, *family.others):
        own = [name for name in names if name.rpartition("/")[0] == part]
        weights = [name for name in own if fnmatch.fnmatch(name, f"{part}/*model*.safetensors")]
        half = [name for name in weights if ".fp16" in name]
        full = [name for name in weights if name not in half and ".non_ema" not in name]
        if part in family.networks and not (full or half):
            raise InputError(
                f"{model}/{part} has no weights as safetensors ({NO_PICKLE}): choose another "
                f"model, such as --model {family.example}"
            )
        wanted += [name for name in own if name.endswith(TEXTS)] + (full or half)
    return wanted


def cached(model: str, name: str) -> Path | None:
    """The folder of the hub's cache, whole or not; None where that lacks a file of this name."""
    from huggingface_hub import try_to_load_from_cache

    if not HUB_ID.fullmatch(model):
        return None
    found = try_to_load_from_cache(**_named(model), filename=name)
    return Path(found).parents[name.count("/")] if isinstance(found, str) else None


def _named(model: str) -> dict[str, Any]:
    """The name and the revision of a hub id, as its library's functions take them."""
    name, _, revision = model.partition("@")
    return {"repo_id": name, "revision": revision or None}


def download_advice(model: str) -> str:
    """How to bring a model of the hub to a machine without a network."""
    name, _, revision = model.partition("@")
    of = f" --revision {revision}" if revision else ""
    patterns = [f"--include '{each}'" for each in (INDEX, *(f"*/*{end}" for end in USED))]
    patterns += [f"--exclude '{each}'" for each in ("*.fp16*", "*.non_ema*", "safety_checker/*")]
    return (
        f"where there is a network, run: hf download {name}{of} --local-dir FOLDER "
        f"{' '.join(patterns)}; then bring FOLDER here and add --model FOLDER"
    )


def _reason(error: Exception) -> str:
    """The most telling words of a network error."""
    name = type(error).__name__
    if "Offline" in name or "LocalEntry" in name:
        return "no network, or HF_HUB_OFFLINE is set"
    if "RepositoryNotFound" in name or "GatedRepo" in name:
        return "the hub knows no such model, or it needs a login (hf auth login)"
    return str(error).strip().partition("\n")[0] or name
