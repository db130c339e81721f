"""Models of diffusers on this machine: which are edited with, where they lie, and whether their
files are whole. Loads no torch."""

from __future__ import annotations

import re
from collections.abc import Iterable
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


@dataclass(frozen=True)
class Family:
    """Models of one architecture, which one module loads."""

    module: str
    """The module here whose `load(parts)` makes the Model."""
    networks: tuple[str, ...]
    """Components that have weights."""
    others: tuple[str, ...]
    """Tokenizers and the scheduler."""
    example: str
    """A model of the family on the hub, with @revision where it is not in the main one."""
    gigabytes: float
    """Size of that model's files that are used, about, in GB."""


SD = Family(
    "stable_diffusion",
    ("unet", "vae", "text_encoder"), ("tokenizer", "scheduler"), "timbrooks/instruct-pix2pix", 4.3,
)  # fmt: skip
SDXL = Family(
    "stable_diffusion", (*SD.networks, "text_encoder_2"),
    (*SD.others, "tokenizer_2"), "diffusers/sdxl-instructpix2pix-768", 12.3,
)  # fmt: skip
KLEIN = Family(
    "klein", ("transformer", *SD.networks[1:]),
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


def require(parts: Iterable[Part]) -> None:
    """Raise InputError with the problems of these parts of a model."""
    if problems := [part.problem for part in parts if part.problem]:
        raise InputError("; ".join(problems))


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


def find(model: str) -> Path:
    """The folder that holds the model, whole or not: `model` as a path, or in the hub's cache.

    Nothing is downloaded. Raises InputError for a model that is in neither place, with the command
    that fetches it.
    """
    if (place := Path(model).expanduser()).exists():
        return place
    if not HUB_ID.fullmatch(model):
        raise InputError(
            f"{model}: no such model folder, and no hub id (like owner/name or "
            "owner/name@revision) either"
        )
    if find_spec("huggingface_hub") is None:
        raise UsageError("a hub id needs huggingface_hub: pip install 'gsedit[diffusers]'")
    if (here := cached(model, INDEX)) is not None:
        return here
    raise InputError(f"{model} is not on this machine; {download_advice(model)}")


def cached(model: str, name: str) -> Path | None:
    """The folder of the hub's cache, whole or not; None where that lacks a file of this name."""
    from huggingface_hub import try_to_load_from_cache

    if not HUB_ID.fullmatch(model):
        return None
    repository, _, revision = model.partition("@")
    found = try_to_load_from_cache(repository, name, revision=revision or None)
    return Path(found).parents[name.count("/")] if isinstance(found, str) else None


def download_advice(model: str) -> str:
    """How to fetch a model of the hub."""
    name, _, revision = model.partition("@")
    of = f" --revision {revision}" if revision else ""
    patterns = [f"--include '{each}'" for each in (INDEX, *(f"*/*{end}" for end in USED))]
    patterns += [f"--exclude '{each}'" for each in ("*.fp16*", "*.non_ema*", "safety_checker/*")]
    return (
        f"where there is a network, run: hf download {name}{of} --local-dir FOLDER "
        f"{' '.join(patterns)}; then bring FOLDER here and add --model FOLDER"
    )
