"""diffusers' folder layout: which family a model is of, and which of its files are used.

Both are told from small JSON files and from names alone, so that a model on the hub is judged
before any of its weights are fetched, and a folder by the same rules. Loads no torch.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gsedit.errors import InputError
from gsedit.models.families import (
    FAMILIES,
    PIPELINES,
    SD,
    SDXL,
    VARIANCE_PRESERVING,
    Component,
    Family,
)

Read = Callable[[str], Mapping[str, Any] | None]
"""The settings in a JSON file of the model, by its name in the folder; None where there is none."""

INDEX = "model_index.json"
VARIANT = "fp16"
"""The half-precision twin: taken where the full one is not there."""
STEMS = {"network": "diffusion_pytorch_model", "encoder": "model"}
"""Names of the weights' files without their ends, by the component's role."""
WORDS = (".json", ".txt", ".model", ".jinja")
"""Ends of the files that tokenizers and processors consist of."""
CONFIGS = {"network": "config.json", "encoder": "config.json", "scheduler": "scheduler_config.json"}
"""Names of the settings' file, by the component's role."""
PLAIN = tuple(name for name in VARIANCE_PRESERVING if name != "LCMScheduler")
"""Schedulers that may be exchanged for each other: they share their noise schedule."""


@dataclass(frozen=True)
class Kind:
    """A model's family, and its classes that a family has several of."""

    family: Family
    pipeline: str
    """Empty for an old folder without model_index.json."""
    scheduler: str
    """Empty where no file names one."""


def identify(place: str, read: Read) -> Kind:
    """The kind of a model, by the class names in its JSON files.

    Raises InputError for a class that no family here has, by its name, with what works. `place` is
    the folder or hub id.
    """
    index = read(INDEX)
    family, pipeline = _family(place, index, read)
    scheduler = ""
    for component in family.components:
        names = _class_names(component, index or {}, read)
        for name in names:
            if component.classes and name not in component.classes:
                works = " or ".join(component.classes)
                raise InputError(
                    f"{place}: its {component.name} is of the class {name}, which gsedit does not "
                    f"run for {family.title}: {works} works; {_advice(family)}"
                )
        if component.role == "scheduler" and names:
            scheduler = _agreed(place, names)
    return Kind(family, pipeline, scheduler)


def _family(place: str, index: Mapping[str, Any] | None, read: Read) -> tuple[Family, str]:
    if index is None:
        unet = read("unet/config.json")
        if unet is None:
            raise InputError(
                f"{place} has neither {INDEX} nor unet/config.json: it is no model in diffusers' "
                f"layout; {_advice(SD)}"
            )
        return (SDXL if unet.get("addition_embed_type") == "text_time" else SD), ""
    name = index.get("_class_name")
    name = name[-1] if isinstance(name, list) and name else name  # [file, class]: someone's own
    if not isinstance(name, str) or name not in PIPELINES:
        works = "; ".join(f"{each.title} ({', '.join(each.pipelines)})" for each in FAMILIES)
        raise InputError(
            f"{place} is a {name or 'model without a pipeline class'}, which gsedit does not edit "
            f"with. These work: {works}. {_advice(SD).capitalize()}"
        )
    return PIPELINES[name], name


def _class_names(component: Component, index: Mapping[str, Any], read: Read) -> list[str]:
    """Every class name that a component's files give it; the index comes first."""
    names = [_listed(index, component.name)] if component.role != "words" else []
    config = CONFIGS.get(component.role)
    settings = read(f"{component.name}/{config}") if config else None
    if settings is not None and component.role == "encoder":
        architectures = settings.get("architectures")
        names += architectures[:1] if isinstance(architectures, list) else []
    elif settings is not None:
        names.append(settings.get("_class_name"))
    return [name for name in names if isinstance(name, str)]


def _listed(index: Mapping[str, Any], name: str) -> str | None:
    """The class of a component in model_index.json: [library, class]."""
    entry = index.get(name)
    return entry[1] if isinstance(entry, list) and len(entry) == 2 else None


def _agreed(place: str, names: Sequence[str]) -> str:
    """The scheduler's class. Raises InputError where files name two that differ in their noise."""
    if len({name if name not in PLAIN else "" for name in names}) > 1:
        raise InputError(
            f"{place}: {INDEX} says that the scheduler is {names[0]}, and scheduler_config.json "
            f"{names[1]}, with another noise schedule: write the one that the weights were trained "
            "with into both"
        )
    return names[0]


def _advice(family: Family) -> str:
    return f"one that works: --model {family.example}"


# ---- files --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Files:
    """The files of a component that are used, by their names in the model's folder."""

    settings: tuple[str, ...]
    weights: tuple[str, ...]
    """One file or shards of one precision; empty where there are none in safetensors."""
    variant: str | None = None
    """`fp16` where only that copy is there."""


def chosen(component: Component, names: Iterable[str]) -> Files:
    """The files of a component, of all that a model consists of.

    One precision, the full one where it is there; a single file rather than shards. No pickles.
    """
    own = [name for name in names if name.rpartition("/")[0] == component.name]
    settings = tuple(name for name in own if name.endswith(WORDS))
    stem = STEMS.get(component.role)
    if stem is None:
        return Files(settings, ())
    indices = [name for name in settings if ".safetensors.index." in name]
    settings = tuple(name for name in settings if name not in indices)
    for variant in (None, VARIANT):
        for sharded in (False, True):
            fits = re.compile(f"{component.name}/{_pattern(stem, variant, sharded)}").fullmatch
            if weights := tuple(sorted(filter(fits, own))):
                table = index_name(component, variant)
                return Files((*settings, *filter(table.__eq__, indices)), weights, variant)
    return Files(settings, ())


def index_name(component: Component, variant: str | None) -> str:
    """Name of the file that lists a component's shards."""
    dot = f".{variant}" if variant else ""
    return f"{component.name}/{STEMS[component.role]}.safetensors.index{dot}.json"


def single_name(component: Component, variant: str | None) -> str:
    """Name of the file that holds all of a component's weights."""
    dot = f".{variant}" if variant else ""
    return f"{component.name}/{STEMS[component.role]}{dot}.safetensors"


def _pattern(stem: str, variant: str | None, sharded: bool) -> str:
    """A pattern of the names of weights; old shards have the variant behind their number."""
    dot, number = (rf"\.{variant}" if variant else ""), r"-\d+-of-\d+" if sharded else ""
    middle = dot + number if dot == "" or not number else f"({dot}{number}|{number}{dot})"
    return rf"{stem}{middle}\.safetensors"
